"""The page about a campaign, made from its folder alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from spacerobot.cli.campaign_spread import spreads

if TYPE_CHECKING:
    from optim.campaign import CampaignEvaluator
    from spacerobot.result import Result
    from viz.report.campaign_section import CampaignReport


def campaign_page(
    folder: Path, tell: Callable[[str], object], evaluator: CampaignEvaluator | None = None
) -> str:
    """HTML of the report about a campaign; as for :func:`campaign_shown`."""
    from viz.report.campaign_section import campaign_report

    shown = campaign_shown(folder, tell, evaluator)
    tell("writing the page")
    return campaign_report(shown)


def campaign_shown(
    folder: Path, tell: Callable[[str], object], evaluator: CampaignEvaluator | None = None
) -> CampaignReport:
    """Data of a campaign that pages show.

    Parameters
    ----------
    folder
        Its store.
    tell
        Called with a text at each stage.
    evaluator
        What made it; made again from the folder if None.

    Raises
    ------
    ResultError
        If the folder holds no readable campaign (see :func:`optim.campaign.reopen`), or none whose
        samples begin.
    """
    from optim.campaign import load_campaign, read_bands, reopen, simulate_sample, summary_data
    from spacerobot.errors import ResultError, SpaceRobotError
    from viz.report.campaign_section import CampaignReport

    if evaluator is None:
        tell("opening the campaign")
        evaluator = reopen(folder)
    tell("computing statistics")
    summary = summary_data(folder, evaluator)
    worst = {name: told["worst"][0] for name, told in summary["gains"].items()}
    tell("reading the kept signals")
    bands = {
        signal: {name: read_bands(folder, signal, name, row["sample"]) for name, row in worst.items()}
        for signal in evaluator.recording.names
    }
    tell("simulating the worst samples")
    results: dict[str, Result] = {}
    faults: dict[str, str] = {}
    for name, row in worst.items():
        if row["unclosed"]:
            continue
        try:
            results[name] = simulate_sample(evaluator, list(row["draw"].values()), name)
        except SpaceRobotError as fault:  # it cannot begin: that is told of it, and the page goes on
            faults[name] = fault.message
    if not results and not faults:
        cause = next(iter(worst.values()))["unclosed"]
        raise ResultError(f"no sample begins, so there is nothing to show: {cause}", source=folder)
    tell("simulating some samples for the animation")
    data = load_campaign(folder)
    return CampaignReport(summary, data, results, bands, spreads(evaluator, data) if results else (), faults)
