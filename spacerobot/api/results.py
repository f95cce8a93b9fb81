"""Results of the public namespace that other packages make, and :func:`load`, which reads any of them."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spacerobot.errors import ResultError
from spacerobot.files import StrPath
from spacerobot.notebook import html_table
from spacerobot.result import Result
from spacerobot.scene import Scene, load_scene

if TYPE_CHECKING:
    import xarray as xr

    from optim.campaign import CampaignEvaluator
    from optim.comparison.compare import Comparison
    from optim.evaluation import BatchResult, GradientResult
    from optim.identification import IdentificationResult
    from optim.planning.search.make_plan import PlanSolution
    from optim.reliability.falsification import Falsification
    from optim.reliability.probability import FailureProbability
    from optim.tuning import TuningResult


@dataclass(frozen=True)
class CampaignResult:
    """A Monte Carlo campaign in its folder.

    Attributes
    ----------
    folder
        Where its samples are stored.
    evaluator
        Simulates samples; see :meth:`simulate`.
    is_complete
        Whether every sample was run; started again with the same folder, an interrupted one continues.
    """

    folder: Path
    evaluator: CampaignEvaluator
    is_complete: bool = True
    _kept: Any = field(default=None, repr=False)

    @cached_property
    def data(self) -> xr.Dataset:
        """Draws (sample, parameter) and metrics (sample, gains, ...) of every sample."""
        from optim.campaign import load_campaign

        return load_campaign(self.folder)

    @cached_property
    def summary(self) -> Mapping[str, Any]:
        """Failure probabilities with confidence intervals, percentiles, worst samples, sensitivities."""
        from optim.campaign import summarise

        return summarise(self.folder, self.evaluator)

    def simulate(self, sample: int, gains: str | None = None) -> Result:
        """Result of one sample.

        Parameters
        ----------
        sample
            Its number.
        gains
            Name of a set of gains; the first if None.
        """
        from optim.campaign import simulate_sample

        draw = self.data.draw.values[sample]
        return simulate_sample(self.evaluator, draw, gains or str(self.data.gains.values[0]))

    def save(self, path: StrPath) -> CampaignResult:
        """Copy the campaign's folder.

        Raises
        ------
        ResultError
            If it cannot be copied, or something is there already.
        """
        return CampaignResult(_copied(self.folder, path), self.evaluator, self.is_complete)

    @classmethod
    def load(cls, path: StrPath) -> CampaignResult:
        """Open the folder of a campaign.

        Raises
        ------
        ResultError
            If it holds none, or was made by another version or from other URDFs.
        """
        from optim.campaign import reopen

        return cls(Path(path), reopen(Path(path)))

    def __repr__(self) -> str:
        """Name and failure probabilities, in one line."""
        failures = (
            f"{name} fails with {100 * told['failure']['any']['value']:.3g} %"
            for name, told in self.summary["gains"].items()
        )
        return f"<CampaignResult of {self.summary['samples']} samples: {', '.join(failures)}>"

    def _repr_html_(self) -> str:
        """Failure probabilities for notebooks."""
        rows = [("samples", str(self.summary["samples"])), ("folder", str(self.folder))]
        for name, told in self.summary["gains"].items():
            any_ = told["failure"]["any"]
            text = f"{100 * any_['value']:.3g} %"
            if any_["low"] is not None:
                text += f" ({100 * any_['low']:.3g} to {100 * any_['high']:.3g} %)"
            rows.append((f"probability of failure, gains {name}", text))
        return html_table("Campaign", rows)


@dataclass(frozen=True)
class PlanResult:
    """A planned motion, verified by replay.

    Attributes
    ----------
    data
        The motion over time, labelled and with units, as in ``plan.nc``.
    summary
        Cost and its terms, durations, verification and how it was found, as in ``plan.json``.
    folder
        Where it was read from or written to, if it was.
    planned
        The solved problem, from :func:`spacerobot.plan`; None where it was read from files.
    """

    data: xr.Dataset
    summary: Mapping[str, Any]
    folder: Path | None = None
    planned: PlanSolution | None = field(default=None, repr=False)

    @classmethod
    def of(cls, planned: PlanSolution) -> PlanResult:
        """Of a solved problem."""
        from optim.planning.output.plan_folder import dataset, summary

        return cls(dataset(planned), summary(planned), None, planned)

    @property
    def cost(self) -> float:
        """Optimal cost."""
        return float(self.summary["cost"])

    @property
    def duration_s(self) -> float:
        """Duration of all phases [s]."""
        return float(self.summary["duration_s"])

    def scene(self) -> Scene:
        """Scene of the scenario that follows the plan, which is that of ``followed.yaml``."""
        from optim.planning.output.plan_folder import FOLLOWED, write

        if self.folder is not None:
            return load_scene(self.folder / FOLLOWED, expand_xacro=False)
        assert self.planned is not None  # a result has a folder, or is just solved
        # a scenario takes the motion from the plan's file, so that the scene is that of a plan that was saved
        with tempfile.TemporaryDirectory(prefix="spacerobot-plan-") as folder:
            write(self.planned, folder)
            scene = load_scene(Path(folder) / FOLLOWED, expand_xacro=False)
        return replace(scene, source=self.planned.scene.source)

    def save(self, path: StrPath) -> PlanResult:
        """Write ``plan.nc``, ``plan.json`` and ``followed.yaml``, the scenario that follows the plan.

        Raises
        ------
        ResultError
            If the folder holds something else or cannot be written.
        """
        from optim.planning.output.plan_folder import SUMMARY, write
        from spacerobot.result import check_folder

        if self.planned is None:
            assert self.folder is not None
            return replace(self, folder=_copied(self.folder, path))
        check_folder(path, SUMMARY)
        write(self.planned, path)
        return replace(self, folder=Path(path))

    @classmethod
    def load(cls, path: StrPath) -> PlanResult:
        """Read the folder of a plan.

        Raises
        ------
        ResultError
            If it holds none.
        """
        from optim.planning.output.plan_folder import read

        return cls(*read(path), Path(path))

    def __repr__(self) -> str:
        """Scenario, duration and cost, in one line."""
        return f"<PlanResult {self.summary['scenario']}: {self.duration_s:.4g} s, cost {self.cost:.6g}>"

    def _repr_html_(self) -> str:
        """Duration, cost and verification, for notebooks."""
        verification = self.summary["verification"]
        rows = [("duration", f"{self.duration_s:.6g} s"), ("cost", f"{self.cost:.6g}")]
        rows += [(f"cost: {name}", f"{value:.6g}") for name, value in self.summary["terms"].items()]
        rows.append(("residual", f"{verification['residual']:.3g}"))
        rows.append(("second order", str(verification["second_order"])))
        return html_table(f"Plan of {self.summary['scenario']}", rows)


@dataclass(frozen=True)
class ComparisonResult:
    """Tuning methods compared on several benchmark problems.

    Attributes
    ----------
    summary
        Objectives, costs, running times and robustness of each method, as in ``comparison.json``.
    folder
        Where it was read from or written to, if it was.
    comparison
        All runs, from :func:`spacerobot.compare`; None where it was read from files.
    """

    summary: Mapping[str, Any]
    folder: Path | None = None
    comparison: Comparison | None = field(default=None, repr=False)

    @classmethod
    def of(cls, comparison: Comparison) -> ComparisonResult:
        """Of its runs."""
        from optim.comparison.report import to_data

        return cls(to_data(comparison), None, comparison)

    def save(self, path: StrPath) -> ComparisonResult:
        """Write ``comparison.json``, and each evaluated design as a result.

        Raises
        ------
        ResultError
            If something cannot be written.
        """
        from optim.comparison.results import write

        if self.comparison is None:
            assert self.folder is not None
            return replace(self, folder=_copied(self.folder, path))
        return replace(self, summary=write(self.comparison, path), folder=Path(path))

    @classmethod
    def load(cls, path: StrPath) -> ComparisonResult:
        """Read the folder of a comparison.

        Raises
        ------
        ResultError
            If it holds none.
        """
        file = Path(path) / "comparison.json"
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as fault:
            raise ResultError(f"holds no comparison that can be read: {fault}", source=file) from None
        return cls(data, Path(path))

    def __repr__(self) -> str:
        """Name and problems, in one line."""
        problems = ", ".join(one["name"] for one in self.summary["problems"])
        return f"<ComparisonResult {self.summary['name']}: {problems}>"

    def _repr_html_(self) -> str:
        """Conclusion, and each method's best objective on each problem, for notebooks."""
        rows = [("conclusion", str(self.summary["conclusion"]))]
        for one in self.summary["problems"]:
            for name, method in one["methods"].items():
                rows.append((f"{one['name']}, {name}", f"{method['objective']['best']}"))
        return html_table(f"Comparison {self.summary['name']}", rows)


def load(
    path: StrPath,
) -> (
    Result
    | CampaignResult
    | PlanResult
    | ComparisonResult
    | TuningResult
    | GradientResult
    | BatchResult
    | IdentificationResult
    | FailureProbability
    | Falsification
):
    """Read what a result's ``save`` wrote, or a command with ``--out``.

    Parameters
    ----------
    path
        Folder of a result, campaign, plan, comparison or tuning, or file of a gradient, batch,
        identification, failure probability or falsification.

    Returns
    -------
    object
        Of the class that was saved. A folder with a tuning's best design as a result gives the tuning, whose
        result is read by :meth:`spacerobot.Result.load`.

    Raises
    ------
    ResultError
        If it is none of these or cannot be read.
    """
    path = Path(path)
    if path.is_file() and path.suffix == ".json":
        from optim.identification import IdentificationResult
        from optim.reliability.falsification import Falsification
        from optim.reliability.probability import FailureProbability

        try:
            key = next(iter(json.loads(path.read_text(encoding="utf-8"))))
        except (OSError, ValueError, TypeError, StopIteration) as fault:
            raise ResultError(f"cannot be read: {fault}", source=path) from None
        kinds = {kind.key: kind for kind in (IdentificationResult, FailureProbability, Falsification)}
        if key not in kinds:
            raise ResultError(f"holds {key!r}, allowed: {', '.join(kinds)}", source=path)
        return kinds[key].load(path)
    if path.is_file():
        from optim.evaluation import load_evaluation

        return load_evaluation(path)
    if not path.is_dir():
        raise ResultError("no such file or folder", source=path)
    names = {found.name for found in path.iterdir()}
    if "campaign.json" in names:
        return CampaignResult.load(path)
    if "comparison.json" in names:
        return ComparisonResult.load(path)
    if "tuning.json" in names:
        from optim.tuning import TuningResult

        return TuningResult.load(path)
    return PlanResult.load(path) if "plan.json" in names else Result.load(path)


def _copied(folder: Path, path: StrPath) -> Path:
    """Copy of a folder; the folder itself if it is the same.

    Raises
    ------
    ResultError
        If it cannot be copied, or something is there already.
    """
    target = Path(path)
    if target.resolve() == folder.resolve():
        return folder
    try:
        shutil.copytree(folder, target)
    except OSError as fault:
        raise ResultError(f"cannot be written: {fault}", source=target) from None
    return target
