"""Studies of a plan: the Pareto front of two terms of its cost, and the design that minimises it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, Self, Unpack

from spacerobot.api.options import PlanOptions, journals
from spacerobot.api.results import PlanResult
from spacerobot.api.study import Playback, Study
from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Content
from spacerobot.result import Result, check_folder
from spacerobot.scene import Scene, to_scene
from spacerobot.simulation import Progress

if TYPE_CHECKING:
    from optim.planning.studies.design_study import DesignStudy
    from optim.planning.studies.pareto_front import ParetoFront
    from viz.figures import Drawing


@dataclass(frozen=True)
class ParetoFrontResult(Study):
    """Pareto front of two terms of a plan's cost.

    Attributes:
        summary: Terms, units and points, as in ``front.json``: each point has its ``values`` by term in SI
            units, its ``status`` (``efficient``, ``dominated`` or ``refused``), the ``changes`` of the
            scenario that give it, and the summary of its plan.
        folder: Folder that the front was read from or written to, or None.
        solution: Solved problems, from :func:`spacerobot.pareto_front`; None if the front was read.
    """

    name: ClassVar[str] = "Pareto front"
    file: ClassVar[str] = "front.json"
    job: ClassVar[str] = "front.json"

    summary: Mapping[str, Any]
    folder: Path | None = None
    solution: ParetoFront | None = field(default=None, repr=False)

    @property
    def points(self) -> Sequence[Mapping[str, Any]]:
        """Points from one end of the front to the other."""
        points: Sequence[Mapping[str, Any]] = self.summary["points"]
        return points

    def plan(self, name: str) -> PlanResult:
        """Plan of a point.

        Args:
            name: Name of the point, such as ``point_3``.

        Raises:
            ResultError: If the point is unknown or has no plan.
        """
        if self.solution is None:
            assert self.folder is not None
            return PlanResult.load(self.folder / name)
        plans = {point.name: point.plan for point in self.solution.points if point.plan is not None}
        if name not in plans:
            raise ResultError(f"no plan of a point {name!r}; allowed: {', '.join(plans)}")
        return PlanResult.of(plans[name])

    def write(self, folder: Path) -> Self:
        """Write ``front.json``, and the plan of each point to a subfolder.

        Raises:
            ResultError: If the folder cannot be written.
        """
        from optim.planning.output.front_folder import write

        assert self.solution is not None
        return replace(self, summary=write(self.solution, folder), folder=folder)

    @classmethod
    def load(cls, path: StrPath) -> Self:
        """Read the folder of a Pareto front.

        Raises:
            ResultError: If the folder has no Pareto front.
        """
        from optim.planning.output.front_folder import FRONT

        return cls(_read(Path(path) / FRONT, "points"), Path(path))

    def content(self) -> Sequence[Content]:
        """Table of the points: values and cost, or the reason why a point has no plan."""
        from optim.planning.output.front_folder import front_table

        return [front_table(self.summary)]

    def drawings(self, simulated: Sequence[Result]) -> dict[str, Drawing]:
        """Figure of the front."""
        from viz.figures.pareto_front import front

        return {"front": front(self.summary)}

    def playback(self, progress: Progress) -> NoReturn:
        """Raise a ``ResultError``, because a front has several motions instead of one."""
        message = "a Pareto front has no motion to play; name the plan of a point"
        raise ResultError(message, source=self.folder)

    def page(self, progress: Progress) -> NoReturn:
        """Always raise a ``ResultError``: each point has a page."""
        raise ResultError("a Pareto front has no page; name the plan of a point", source=self.folder)

    def __repr__(self) -> str:
        """Scenario, terms and number of points, in one line."""
        terms = " and ".join(self.summary["terms"])
        return f"<ParetoFrontResult {self.summary['scenario']}: {terms}, {len(self.points)} points>"


@dataclass(frozen=True)
class DesignStudyResult(Study):
    """Design that minimises a plan's optimal cost, and sweeps of the cost over each variable.

    Attributes:
        summary: Variables, designs and sweeps, as in ``design.json``.
        plan: Plan of the optimal design, refined and verified.
        folder: Folder that the study was read from or written to, or None.
        solution: All designs, from :func:`spacerobot.design_study`; None if the study was read from files.
    """

    name: ClassVar[str] = "design study"
    file: ClassVar[str] = "design.json"
    job: ClassVar[str] = "plan.json"

    summary: Mapping[str, Any]
    plan: PlanResult
    folder: Path | None = None
    solution: DesignStudy | None = field(default=None, repr=False)

    @property
    def design(self) -> dict[str, float]:
        """Optimal values of the variables, in the scenario's units."""
        return {name: one["optimum"] for name, one in self.summary["variables"].items()}

    def write(self, folder: Path) -> Self:
        """Write ``design.json`` and the plan of the optimal design.

        Raises:
            ResultError: If the folder cannot be written.
        """
        from optim.planning.output.study_folder import write

        assert self.solution is not None
        summary = write(self.solution, folder)
        return replace(self, summary=summary, plan=replace(self.plan, folder=folder), folder=folder)

    @classmethod
    def load(cls, path: StrPath) -> Self:
        """Read the folder of a design study.

        Raises:
            ResultError: If the folder has no design study.
        """
        from optim.planning.output.study_folder import DESIGN

        return cls(_read(Path(path) / DESIGN, "variables"), PlanResult.load(path), Path(path))

    def content(self) -> Sequence[Content]:
        """Tables of the optimal plan, of the variables, and of the optimal cost over each variable."""
        from optim.planning.output.study_folder import study_tables

        return [*self.plan.content(), *study_tables(self.summary)]

    def notices(self) -> Sequence[str]:
        """Warnings about the plan."""
        return self.plan.notices()

    def drawings(self, simulated: Sequence[Result]) -> dict[str, Drawing]:
        """Figure of the optimal cost over each variable, and figures of the optimal plan."""
        from viz.figures.design_study import study

        return {"design": study(self.summary), **self.plan.drawings(simulated)}

    def playback(self, progress: Progress) -> Playback:
        """Animation of a simulation that follows the optimal plan."""
        return self.plan.playback(progress)

    def page(self, progress: Progress) -> str:
        """Page of the optimal plan."""
        return self.plan.page(progress)

    def __repr__(self) -> str:
        """Scenario and optimal values, in one line."""
        values = ", ".join(f"{name} {value:.4g}" for name, value in self.design.items())
        return f"<DesignStudyResult {self.summary['scenario']}: {values}>"


def pareto_front(
    scene: Scene | StrPath,
    terms: Sequence[str] = ("time", "base_rotation"),
    folder: StrPath | None = None,
    *,
    points: int = 9,
    **options: Unpack[PlanOptions],
) -> ParetoFrontResult:
    """Compute the Pareto front of two terms of a plan's cost.

    Args:
        scene: A scene whose scenario has a ``plan`` section, or the scenario's name or file.
        terms: Names of the two terms. If one is ``time``, the duration is swept, otherwise the ratio of the
            two weights.
        folder: Folder for ``front.json`` and the plan of each point. A second call with the folder of an
            interrupted front continues it. Nothing is written if None.
        points: Number of points.
        **options: See :class:`~spacerobot.api.options.PlanOptions`.

    Raises:
        ScenarioError: If they are not two terms with weights, or the duration to be swept is fixed.
        ResultError: If the folder has other content or cannot be written.
    """
    from optim.planning.output.front_folder import to_data
    from optim.planning.studies.pareto_front import FrontRequest, make_front

    if folder is not None:
        check_folder(folder, ParetoFrontResult.job)
    front = make_front(
        to_scene(scene),
        FrontRequest(tuple(terms), points),
        folder=journals(folder),
        **options,
    )
    result = ParetoFrontResult(to_data(front), None, front)
    return result if folder is None else result.save(folder)


def design_study(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    points: int = 9,
    **options: Unpack[PlanOptions],
) -> DesignStudyResult:
    """Optimise the variables of ``plan.design`` together with the motion, and sweep each variable.

    Args:
        scene: A scene whose ``plan`` section has ``design`` variables, or the scenario's name or file.
        folder: Folder for ``design.json`` and the plan of the optimal design. A second call with the folder
            of an interrupted study continues it. Nothing is written if None.
        points: Number of designs of each sweep, from bound to bound.
        **options: See :class:`~spacerobot.api.options.PlanOptions`; the cluster plans for the first design.

    Raises:
        ScenarioError: If the section names no variables, or unknown numbers.
        NoPlanError: If the scenario's own design, or the optimal one, has no verified plan.
        ResultError: If the folder has other content or cannot be written.
    """
    from optim.planning.output.study_folder import to_data
    from optim.planning.studies.design_study import make_study

    if folder is not None:
        check_folder(folder, DesignStudyResult.job)
    study = make_study(to_scene(scene), points, folder=journals(folder), **options)
    result = DesignStudyResult(to_data(study), PlanResult.of(study.plan), None, study)
    return result if folder is None else result.save(folder)


def _read(file: Path, key: str) -> Mapping[str, Any]:
    """Content of a JSON file that must have a key.

    Raises:
        ResultError: If the file cannot be read or has no such key.
    """
    try:
        data: Any = json.loads(file.read_text(encoding="utf-8"))
        if key not in data:
            raise ValueError(f"no {key!r}")
    except (OSError, ValueError, TypeError) as fault:
        raise ResultError(f"cannot be read: {fault}", source=file) from None
    return dict(data)
