"""Results of campaigns, plans and comparisons in the public namespace."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from spacerobot.api.study import Playback, Study
from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath, readable
from spacerobot.common.tables import Content
from spacerobot.result import Result
from spacerobot.scene import Scene, load_scene
from spacerobot.simulation import Progress, simulate

if TYPE_CHECKING:
    import xarray as xr

    from optim.campaign import CampaignEvaluator
    from optim.comparison.compare import Comparison
    from optim.planning.search.make_plan import PlanSolution
    from viz.figures import Drawing


@dataclass(frozen=True)
class CampaignResult(Study):
    """A Monte Carlo campaign in its folder.

    Attributes:
        folder: Folder of the samples.
        evaluator: Evaluator of samples; see :meth:`simulate`.
        is_complete: Whether every sample was run. :func:`spacerobot.campaign` with the same folder continues
            an interrupted campaign.
    """

    name: ClassVar[str] = "campaign"
    file: ClassVar[str] = "campaign.json"
    job: ClassVar[str] = "campaign.json"

    folder: Path
    evaluator: CampaignEvaluator
    is_complete: bool = True
    _kept: Any = field(default=None, repr=False)

    @cached_property
    def data(self) -> xr.Dataset:
        """Parameter draws (sample, parameter) and metrics (sample, gains, ...)."""
        from optim.campaign import load_campaign

        return load_campaign(self.folder)

    @cached_property
    def summary(self) -> Mapping[str, Any]:
        """Failure probabilities with confidence intervals, percentiles, worst samples, sensitivities."""
        from optim.campaign import summarise

        return summarise(self.folder, self.evaluator)

    @property
    def done(self) -> int:
        """Number of finished samples."""
        return int(self.data.sizes["sample"])

    @property
    def total(self) -> int:
        """Number of samples of the complete campaign."""
        return self.evaluator.campaign.count

    def simulate(self, sample: int, gains: str | None = None) -> Result:
        """Simulate one sample again and return its result.

        Args:
            sample: Number of the sample.
            gains: Name of a set of gains; the first if None.
        """
        from optim.campaign import simulate_sample

        draw = self.data.draw.values[sample]
        return simulate_sample(self.evaluator, draw, gains or str(self.data.gains.values[0]))

    @classmethod
    def load(cls, path: StrPath) -> Self:
        """Open the folder of a campaign.

        Raises:
            ResultError: If the folder has no campaign, or one of another version or other URDFs.
        """
        from optim.campaign import reopen

        return cls(Path(path), reopen(Path(path)))

    def __repr__(self) -> str:
        """Name and failure probabilities, in one line."""
        failures = (
            f"{name} fails with {100 * statistics['failure']['any']['value']:.3g} %"
            for name, statistics in self.summary["gains"].items()
        )
        return f"<CampaignResult of {self.summary['samples']} samples: {', '.join(failures)}>"

    def content(self) -> Sequence[Content]:
        """Failure probabilities, percentiles, sensitivities and worst samples."""
        from optim.campaign.analysis.tables import campaign_content

        return campaign_content(self.summary)

    def notices(self) -> Sequence[str]:
        """Warnings about missing samples and about the reliability of the numbers."""
        from optim.campaign.analysis.sentences import unfinished

        return [text for text in (unfinished(self.summary), *self.summary["caveats"]) if text]

    def playback(self, progress: Progress) -> Playback:
        """Animation of the worst samples, which are simulated, with the spread of the metrics."""
        from viz.report.campaign_data import campaign_data
        from viz.report.campaign_section import animated_worst

        campaign = campaign_data(self.folder, progress, self.evaluator)
        if not campaign.worst:
            fault = next(iter(campaign.faults.values()))
            raise ResultError(f"no worst sample can be simulated: {fault}", source=self.folder)
        return Playback(animated_worst(campaign), list(campaign.worst.values()))

    def page(self, progress: Progress) -> str:
        """Page with failure probabilities, distributions, sensitivities and worst samples."""
        from viz.report.campaign_data import campaign_page

        return campaign_page(self.folder, progress, self.evaluator)

    def first_view(self) -> dict[str, Any]:
        """Page with the spread of the metrics, shown before the worst samples are simulated."""
        from viz.report.campaign_data import first_page

        return first_page(self.folder, self.evaluator)


@dataclass(frozen=True)
class PlanResult(Study):
    """A planned motion, verified by replay.

    Attributes:
        data: Motion over time with labels and units, as in ``plan.nc``.
        summary: Cost and its terms, durations, verification and solver runs, as in ``plan.json``.
        folder: Folder that the plan was read from or written to, or None.
        solution: Solved problem, from :func:`spacerobot.plan`; None if the plan was read from files.
    """

    name: ClassVar[str] = "plan"
    file: ClassVar[str] = "plan.json"
    job: ClassVar[str] = "plan.json"

    data: xr.Dataset
    summary: Mapping[str, Any]
    folder: Path | None = None
    solution: PlanSolution | None = field(default=None, repr=False)

    @classmethod
    def of(cls, planned: PlanSolution, sensitivities: Sequence[str] = ()) -> PlanResult:
        """Result of a solved problem.

        Args:
            planned: The solved problem.
            sensitivities: Dotted paths of numbers with respect to which the optimal cost is differentiated.

        Raises:
            ScenarioError: If a path is not a number of the scenario.
        """
        from optim.planning.output.plan_folder import dataset, summary
        from optim.planning.studies.cost_sensitivities import cost_sensitivities

        data = summary(planned)
        if sensitivities:
            data["cost_sensitivities"] = cost_sensitivities(planned, sensitivities)
        return cls(dataset(planned), data, None, planned)

    @property
    def cost(self) -> float:
        """Optimal cost."""
        return float(self.summary["cost"])

    @property
    def duration_s(self) -> float:
        """Duration of all phases [s]."""
        return float(self.summary["duration_s"])

    def scene(self) -> Scene:
        """Scene of ``followed.yaml``, the scenario that follows the plan."""
        from optim.planning.output.plan_folder import FOLLOWED, write

        if self.folder is not None:
            return load_scene(self.folder / FOLLOWED, expand_xacro=False)
        assert self.solution is not None  # without a folder, the plan is a new solution
        # the scenario reads the motion from the plan's file
        with tempfile.TemporaryDirectory(prefix="spacerobot-plan-") as folder:
            write(self.solution, folder)
            scene = load_scene(Path(folder) / FOLLOWED, expand_xacro=False)
        return replace(scene, source=self.solution.scene.source)

    def problem_scene(self) -> Scene:
        """Scene of the planning problem."""
        from optim.planning.output.plan_folder import SCENARIO

        if self.solution is not None:
            return self.solution.scene
        assert self.folder is not None
        return load_scene(self.folder / SCENARIO, expand_xacro=False)

    def write(self, folder: Path) -> Self:
        """Write ``plan.nc``, ``plan.json`` and ``followed.yaml``, the scenario that follows the plan.

        Raises:
            ResultError: If the folder cannot be written.
        """
        from optim.planning.output.plan_folder import write

        assert self.solution is not None
        write(self.solution, folder, self.summary.get("cost_sensitivities"))
        return replace(self, folder=folder)

    @classmethod
    def load(cls, path: StrPath) -> Self:
        """Read the folder of a plan.

        Raises:
            ResultError: If the folder has no plan.
        """
        from optim.planning.output.plan_folder import read

        return cls(*read(path), Path(path))

    def __repr__(self) -> str:
        """Scenario, duration and cost, in one line."""
        return f"<PlanResult {self.summary['scenario']}: {self.duration_s:.4g} s, cost {self.cost:.6g}>"

    def content(self) -> Sequence[Content]:
        """Duration, cost, verification, cost sensitivities and the runs of the solver."""
        from optim.planning.output.plan_tables import plan_tables

        return plan_tables(self.summary)

    def notices(self) -> Sequence[str]:
        """Warnings about the plan and the scenario that follows it."""
        notices: Sequence[str] = self.summary.get("warnings", ())
        return notices

    def drawings(self, simulated: Sequence[Result]) -> dict[str, Drawing]:
        """Figures of the plan, with the first of the given simulations that follow it."""
        from optim.planning.output.constraint_values import with_flown
        from viz.figures.plan import plan_figures

        result, data = next(iter(simulated), None), self.data
        if result is not None and "constraint" in data:
            data = with_flown(data, self.problem_scene(), result.data)
        return dict(plan_figures(data, self.summary, result))

    def playback(self, progress: Progress) -> Playback:
        """Animation of a simulation that follows the plan, with the planned motion drawn in pale colours."""
        return self.followed_by(simulate(self.scene(), progress=progress))

    def followed_by(self, simulated: Result) -> Playback:
        """Animation of a result that follows the plan, with the planned motion drawn in pale colours."""
        from viz.page.plan_overlay import beside_its_plan

        return Playback(beside_its_plan(simulated, self.problem_scene(), self.data), [simulated])

    def page(self, progress: Progress) -> str:
        """Page with motion, binding limits, cost, replay and mesh."""
        from viz.report.plan_section import plan_report

        played = self.playback(progress)
        return plan_report(self.data, self.summary, played.results[0], played.data)


@dataclass(frozen=True)
class ComparisonResult(Study):
    """Tuning methods compared on several benchmark problems.

    Attributes:
        summary: Objectives, costs, running times and robustness of each method, as in ``comparison.json``.
        folder: Folder that the comparison was read from or written to, or None.
        solution: All runs, from :func:`spacerobot.compare`; None if the comparison was read from files.
    """

    name: ClassVar[str] = "comparison"
    file: ClassVar[str] = "comparison.json"
    job: ClassVar[str] = "comparison.json"

    summary: Mapping[str, Any]
    folder: Path | None = None
    solution: Comparison | None = field(default=None, repr=False)

    @classmethod
    def of(cls, comparison: Comparison) -> ComparisonResult:
        """Result of a comparison's runs."""
        from optim.comparison.report import to_data

        return cls(to_data(comparison), None, comparison)

    def write(self, folder: Path) -> Self:
        """Write ``comparison.json``, and each evaluated design as a result.

        Raises:
            ResultError: If a file cannot be written.
        """
        from optim.comparison.results import write

        assert self.solution is not None
        return replace(self, summary=write(self.solution, folder), folder=folder)

    @classmethod
    def load(cls, path: StrPath) -> Self:
        """Read the folder of a comparison.

        Raises:
            ResultError: If the folder has no comparison.
        """
        file = Path(path) / cls.file
        with readable("comparison", file):
            data = json.loads(file.read_text(encoding="utf-8"))
        return cls(data, Path(path))

    def __repr__(self) -> str:
        """Name and problems, in one line."""
        problems = ", ".join(one["name"] for one in self.summary["problems"])
        return f"<ComparisonResult {self.summary['name']}: {problems}>"

    def content(self) -> Sequence[Content]:
        """Conclusion, expected running times, and the tables of each problem."""
        from optim.comparison.tables import comparison_content

        return comparison_content(self.summary)

    def notices(self) -> Sequence[str]:
        """Warnings about best designs that are not trustworthy."""
        from optim.comparison.tables import caveats

        return [warning_text for benchmark in self.summary["problems"] for warning_text in caveats(benchmark)]

    def playback(self, progress: Progress) -> Playback:
        """Animation of the methods' best designs, side by side."""
        from viz.page.animation import animation
        from viz.report.comparison_section import designs_of

        heading, designs = designs_of(self._saved())
        results = list(designs.values())
        return Playback(animation(*results, names=list(designs), title=heading), results)

    def page(self, progress: Progress) -> str:
        """Page with the tables, convergence and designs of each problem."""
        from viz.report.comparison_section import comparison_report

        return comparison_report(self._saved())

    def _saved(self) -> Path:
        """Folder of the comparison.

        Raises:
            ResultError: If the comparison is not saved.
        """
        if self.folder is None:
            raise ResultError("a comparison is shown from its files; save it first")
        return self.folder
