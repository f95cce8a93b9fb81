"""Data of the animated page for a folder, whichever command wrote it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spacerobot.cli.campaign_page import campaign_shown
from spacerobot.cli.campaign_spread import distributions

if TYPE_CHECKING:
    from optim.campaign import CampaignEvaluator
    from spacerobot.result import Result

Tell = Callable[[str], None]


@dataclass(frozen=True)
class PageData:
    """Data of the page, and the results in it."""

    data: dict[str, Any]
    results: Sequence[Result]


def to_play(folders: Sequence[Path], tell: Tell) -> PageData:
    """Page data of folders of results, or of one comparison, campaign or plan.

    Raises
    ------
    ResultError
        If a folder holds none of these, or the results cannot be compared.
    """
    from optim.planning.output.plan_folder import FOLLOWED, is_plan
    from spacerobot.result import Result
    from viz.page.animation import animation
    from viz.report.comparison_section import COMPARISON

    if is_campaign(folders):
        return campaign(folders[0], tell)
    if len(folders) == 1:
        for file, play in ((COMPARISON, comparison), (FOLLOWED, plan)):
            if (folders[0] / file).is_file():
                return play(folders[0], tell)
    if len(folders) == 2 and is_plan(folders[1]):
        return _over_its_plan(Result.load(folders[0]), folders[1])
    results = [Result.load(folder) for folder in folders]
    return PageData(animation(*results), results)


def is_campaign(folders: Sequence[Path]) -> bool:
    """Whether these are the one folder of a campaign."""
    from optim.campaign.store.folder import HEAD

    return len(folders) == 1 and (folders[0] / HEAD).is_file()


def comparison(folder: Path, tell: Tell) -> PageData:
    """The first problem's untuned design and each method's best."""
    from viz.page.animation import animation
    from viz.report.comparison_section import designs_of

    del tell
    title, named = designs_of(folder)
    return PageData(animation(*named.values(), names=list(named), title=title), list(named.values()))


def campaign(folder: Path, tell: Tell, evaluator: CampaignEvaluator | None = None) -> PageData:
    """The worst sample of each set of gains, together with all samples."""
    from spacerobot.errors import ResultError
    from viz.report.campaign_section import animated_worst

    shown = campaign_shown(folder, tell, evaluator)
    if not shown.worst:
        raise ResultError(
            f"no worst sample can be simulated: {next(iter(shown.faults.values()))}", source=folder
        )
    return PageData(animated_worst(shown), list(shown.worst.values()))


def campaign_at_once(folder: Path) -> tuple[dict[str, Any], CampaignEvaluator]:
    """Data of a page about a campaign as far as nothing must be compiled for it, and what made the campaign.

    Raises
    ------
    ResultError
        If the folder holds no campaign that can be told of.
    """
    from optim.campaign import load_campaign, reopen
    from viz.page.animation import still

    evaluator = reopen(folder)
    data, scene = load_campaign(folder), evaluator.members[0].scene
    design = {"name": scene.scenario.name, "values": [], "numbers": {}}
    panel = {"metrics": [], "designs": [design], "first": 1, "spreads": distributions(evaluator, data)}
    about = f"campaign of {data.sizes['sample']} samples; the worst ones are being simulated"
    return still(scene, about=about) | {"panel": panel}, evaluator


def plan(folder: Path, tell: Tell) -> PageData:
    """The motion of a plan, and the flight of the scenario that follows it."""
    from optim.planning.output.plan_folder import FOLLOWED
    from spacerobot.scene import load_scene
    from spacerobot.simulation import simulate

    return _over_its_plan(simulate(load_scene(folder / FOLLOWED, expand_xacro=False), progress=tell), folder)


def _over_its_plan(flown: Result, folder: Path) -> PageData:
    from optim.planning.output.plan_folder import SCENARIO, read
    from spacerobot.scene import load_scene
    from viz.page.plan_overlay import beside_its_plan

    return PageData(
        beside_its_plan(flown, load_scene(folder / SCENARIO, expand_xacro=False), read(folder)[0]), [flown]
    )
