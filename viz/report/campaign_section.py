"""Report section of a campaign: failure rates, distributions, sensitivities, worst samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from optim.campaign.analysis.sentences import (
    capturing,
    depends,
    drawn,
    failing,
    failure_criteria,
    mixed,
    quantity_of,
    stepping,
    unfinished,
    why_worst,
    with_gains,
)
from optim.campaign.analysis.tables import failure_table, pair_table, percentile_table
from spacerobot.common.tables import escape, unit_scale
from spacerobot.quantities import find_quantity, metrics
from spacerobot.result import Result
from viz.figures import (
    SampleSpread,
    bands,
    distributions,
    moving_components,
    sensitivities,
    to_bytes,
)
from viz.figures.style import Drawing
from viz.page.animation import animation
from viz.page.page import page as animated
from viz.report.report import SECTIONS, ReportSection, page, report
from viz.report.sections import picture, playable, still_png, table

if TYPE_CHECKING:
    from optim.campaign import QuantileBands

KEPT = ("warnings", "numbers", "figures", "ledger", "assumptions", "origins")
"""Sections that a campaign's report takes over for its worst samples."""

MOST_ANIMATED = 4


@dataclass(frozen=True)
class CampaignReport:
    """Report about a campaign.

    Attributes:
        summary: As in ``summary.json``.
        data: Draws and metrics of every sample.
        worst: Simulation of the worst sample, by set of gains.
        bands: Percentile bands of each recorded signal, by set of gains.
        spreads: Data of all samples for the animated page, one entry for each set of gains; see
            :func:`viz.report.campaign_data.spreads`.
        faults: Reason why the worst sample cannot be simulated, by set of gains.
    """

    summary: Mapping[str, Any]
    data: xr.Dataset
    worst: Mapping[str, Result]
    bands: Mapping[str, Mapping[str, QuantileBands]]
    spreads: Sequence[Mapping[str, Any]] = ()
    faults: Mapping[str, str] = field(default_factory=dict)


def campaign_report(campaign: CampaignReport) -> str:
    """HTML of a campaign's report; the worst samples of the first sets of gains are animated."""
    summary = campaign.summary
    written = {
        "campaign": ("In short", _in_short(summary)),
        "spread": ("How the numbers spread", _spread(campaign)),
        "matters": ("What matters", _matters(summary)),
        "series": ("Signals over time", _series(campaign)),
        "worst": ("Worst samples", _worst(campaign)),
        "design": ("Design of the campaign", _design(summary)),
    }
    title = f"Campaign of {summary['name']}: {summary['samples']} samples"

    def section(name: str, heading: str, text: str) -> ReportSection:
        return ReportSection(name, heading, lambda _: text)

    sections_written = [
        (section(name, heading, text), text) for name, (heading, text) in written.items() if text
    ]
    results = [replace(result, folder=None) for result in campaign.worst.values()]
    if not results:
        return page(title, sections_written)
    size_px = (900, 540) if len(results) == 1 else (640, 400)
    stills = [still_png(result, size_px) for result in list(campaign.worst.values())[:MOST_ANIMATED]]
    text = playable(animated(animated_worst(campaign)), stills, 640)
    left = list(campaign.worst)[MOST_ANIMATED:]
    text += f"<p>Not animated: the worst samples of {escape(', '.join(left))}.</p>" if left else ""
    rest = [
        replace(part, title=f"{part.title}: worst samples") if part.name != "origins" else part
        for part in SECTIONS
        if part.name in KEPT
    ]
    # the verdict first, then the picture
    first, *others = (part for part, _ in sections_written)
    sections = [first, section("animation", "Worst samples, animated", text), *others, *rest]
    return report(*results, title=title, sections=sections)


def _in_short(summary: Mapping[str, Any]) -> str:
    sentences = [
        say(name, statistics, summary)
        for say in (failing, capturing)
        for name, statistics in summary["gains"].items()
    ]
    text = "".join(f"<p class='outcome'>{escape(sentence)}</p>" for sentence in sentences if sentence)
    warnings = [unfinished(summary), *summary["caveats"]]
    items = "".join(f"<li>{escape(warning)}</li>" for warning in warnings if warning)
    if items:
        text += f"<ul class='warnings'>{items}</ul>"
    criteria = escape(failure_criteria(summary))
    text += "" if criteria in text else f"<p>{criteria}</p>"
    text += failure_table(summary).html()
    if summary["against"]:
        text += pair_table(summary).html()
    return text


def _design(summary: Mapping[str, Any]) -> str:
    """Number of samples, sampling design, and the parameters with their units, as HTML."""
    sets, step = list(summary["gains"]), stepping(summary)
    named = ", ".join(f"{name} [{unit}]" for name, unit in summary["units"].items())
    about = (
        f"{summary['samples']} of {summary['of']} samples (design {summary['design']}, seed "
        f"{summary['seed']}) of {named}."
    )
    if len(sets) > 1:
        about += f" Each sample was simulated with every set of gains: {', '.join(sets)}."
    return f"<p>{escape(about)}</p>" + (f"<p>{escape(step)}</p>" if step else "")


def _spread(campaign: CampaignReport) -> str:
    spreads = []
    for metric, quantity in metrics().items():
        if quantity.limit is None or metric not in campaign.data:
            continue
        factor, unit = unit_scale(str(campaign.data[metric].attrs["units"]))
        largest = factor * campaign.data[metric].max(f"{metric}_of", skipna=False)
        samples = {str(name): largest.sel(gains=name).values for name in campaign.data.gains.values}
        most = campaign.summary["limits"].get(quantity.limit)
        limit = None if most is None else factor * most
        missing = "diverged" if quantity.exists is None else "without a value"
        spreads.append(SampleSpread(samples, quantity_of(metric), unit, limit, missing))
    # percentiles of every recorded metric, collapsed
    text = ""
    for name, statistics in campaign.summary["gains"].items():
        inside = percentile_table(name, statistics, campaign.summary).html()
        of = f", gains {escape(name)}" if len(campaign.summary["gains"]) > 1 else ""
        text += f"<details><summary>percentiles{of}</summary>{inside}</details>"
    if not spreads:
        return text
    note = "The share of samples (upwards) that stay below a value (to the right); the marks are 50 and 95 %."
    return _figure(distributions(spreads), note) + text


def _matters(summary: Mapping[str, Any]) -> str:
    """Dependence of each metric on the parameters: in sentences, and as bars for the first one."""
    parts = []
    for name, statistics in summary["gains"].items():
        sentences = [depends(metric, entry) for metric, entry in statistics["matters"].items()]
        items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
        heading = f"<h3>{escape(with_gains(name))}</h3>" if len(summary["gains"]) > 1 else ""
        metric, entry = next(iter(statistics["matters"].items()))
        shares, names = entry["kind"] == "sobol", summary["parameters"]
        rows = {"share": entry["total"]} if shares else {"as it grows": entry["value"]}
        rows |= {} if shares else {"away from its middle": entry["away"]}
        values = {way: np.array([row[name] or 0.0 for name in names]) for way, row in rows.items()}
        bars = ""
        if len(names) >= 2 and any(row.any() for row in values.values()):
            drawing = sensitivities(names, values, quantity=metric)
            kind = "total Sobol' index" if shares else "rank correlation"
            drawing.axes[0].set_xlabel(f"{kind} with the {quantity_of(metric)}")
            of = f", gains {name}" if len(summary["gains"]) > 1 else ""
            bars = _figure(drawing, f"Dependence of the {quantity_of(metric)} on the parameters{of}")
        if bars and len(summary["gains"]) > 1:
            bars = f"<details><summary>every parameter, gains {escape(name)}</summary>{bars}</details>"
        parts.append(f"{heading}<ul>{items}</ul>{bars}")
    entries = [entry for statistics in summary["gains"].values() for entry in statistics["matters"].values()]
    note = mixed(summary)
    kinds = {entry["kind"] for entry in entries}
    texts = []
    if "rank_correlation" in kinds:
        texts.append(
            "Numbers in brackets are rank correlations, from -1 (the metric always falls as the parameter "
            "grows) to +1 (it always grows). Correlations that could be due to chance are left out."
        )
    if "sobol" in kinds:
        texts.append("Shares of the variance are total Sobol' indices; they add up to more than 100 %.")
    measures_told = "".join(f"<p>{escape(text)}</p>" for text in texts)
    return measures_told + (f"<p>{escape(note)}</p>" if note else "") + "".join(parts)


def _series(campaign: CampaignReport) -> str:
    parts = []
    for signal, by_gains in campaign.bands.items():
        parts.append(f"<h3>{escape(signal.replace('_', ' '))}</h3>")
        for name, signal_bands in by_gains.items():
            if not moving_components(signal_bands):
                parts.append(f"<p>{escape(with_gains(name))}: always the same, in every sample.</p>")
                continue
            caption = signal.replace("_", " ") + (f" with the gains {name}" if len(by_gains) > 1 else "")
            scale = "; each figure has its own scale" if len(by_gains) > 1 else ""
            lost = len(campaign.data.sample) - int(signal_bands.left[-1])
            gone = f"; diverged, and counted until then: {lost}" if lost else ""
            parts.append(_figure(bands(signal_bands), f"{caption}, over all samples{gone}{scale}"))
    return "".join(parts)


def _worst(campaign: CampaignReport) -> str:
    """HTML of the worst sample under each set of gains.

    It consists of a table of the drawn parameters with a column for each set, the errors of samples that
    cannot be simulated, and the commands that repeat the simulations.
    """
    summary = campaign.summary
    worst = {name: entry["worst"][0] for name, entry in summary["gains"].items()}
    rows = [["sample", *(str(row["sample"]) for row in worst.values())]]
    units = {one["metric"]: one["unit"] for one in next(iter(summary["gains"].values()))["metrics"]}
    reasons = []
    for row in worst.values():
        if not (reason := why_worst(row)):
            factor, unit = unit_scale(units[row["metric"]])
            failed = ", past its limit" if find_quantity(row["metric"]).limit in row["failed"] else ""
            reason = f"{quantity_of(row['metric'])}, {factor * row['value']:.4g} {unit}{failed}"
        reasons.append(reason)
    rows.append(["worst in", *reasons])
    for key in summary["parameters"]:
        rows.append([key, *(drawn(summary, key, row["draw"][key]) for row in worst.values())])
    text = table(["gains", *worst], rows)
    for name, fault in campaign.faults.items():
        entry = f"gains {name}, sample {worst[name]['sample']}, cannot be simulated: {fault}"
        text += f"<p>{escape(entry)}</p>"
    for name, row in worst.items():
        of = f", gains {name}" if len(worst) > 1 else ""
        title = escape(f"command that runs it again{of}")
        text += f"<details><summary>{title}</summary><pre>{escape(row['command'])}</pre></details>"
    return text


def animated_worst(campaign: CampaignReport) -> dict[str, Any]:
    """Data of the page that animates the first sets' worst samples, with the spread of all samples."""
    named = {
        f"Gains {name}, sample {campaign.summary['gains'][name]['worst'][0]['sample']}": result
        for name, result in list(campaign.worst.items())[:MOST_ANIMATED]
    }
    title = f"Campaign of {campaign.summary['name']}: worst samples"
    data = animation(*named.values(), names=list(named), title=title, autoplay=False, first=1)
    return data | {"panel": data["panel"] | {"spreads": list(campaign.spreads)}}


def _figure(drawing: Drawing, title: str) -> str:
    return picture("", title, to_bytes(drawing, "svg"))
