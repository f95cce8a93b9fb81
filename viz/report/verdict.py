"""First lines of a report: the outcome of a run, or of an analysis of margins, in a sentence or two."""

from __future__ import annotations

import numpy as np

from spacerobot.common.tables import unit_scale
from spacerobot.linear import SavedMargins
from spacerobot.linear.loop_margins import stability_words
from spacerobot.result import Result
from spacerobot.result.table import status_text


def margins_verdict(margins: SavedMargins) -> list[str]:
    """Sentences on the stability at each instant, with the loop of the smallest disk margin."""
    sentences = []
    for k, label in enumerate(map(str, margins.data.instant.values)):
        instant = margins.data.isel(instant=k)
        sentence = f"{label}: {stability_words(bool(instant.stable), float(instant.growth_rate))}."
        disks = np.nan_to_num(instant.disk.values, nan=np.inf)
        if disks.size and np.isfinite(disks.min()):
            loop = instant.isel(loop=int(disks.argmin()))
            sentence += (
                f" The least disk margin is {float(loop.disk):.3f}, of {loop.loop.item()}, whose gain may "
                f"change by {float(loop.gain_down):.1f} to {float(loop.gain_up):+.1f} dB and whose phase by "
                f"{float(loop.phase):.1f} deg. (6 dB and 36 deg together correspond to 0.66.)"
            )
        sentences.append(sentence)
    return sentences


def verdict(result: Result) -> str:
    """Outcome, time of each capture or reason of each miss, largest tip error, and whether to trust it."""
    summary, sentences = result.summary, []
    times: dict[str, float] = {}
    for event in summary.get("events", ()):
        if event["kind"] == "captured":
            times.setdefault(event["who"], event["time_s"])
    if not result.completed:
        sentences.append(f"Not completed: {status_text(summary['status'])}.")
    elif summary.get("outcome"):
        grasps = ", ".join(f"{grasp} at {time:.4g} s" for grasp, time in times.items())
        outcome = str(summary["outcome"])
        sentences.append(f"{outcome[:1].upper()}{outcome[1:]}{f': {grasps}' if grasps else ''}.")
    else:
        sentences.append(f"Completed, {float(result.data.time.values[-1]):.4g} s.")
    sentences += [f"{grasp}: {why['words']}." for grasp, why in summary.get("missed", {}).items()]
    tips = {tip: summary["tip_error"][tip]["norm"]["rms_m"] for tip in result.led_tips}
    if tips and result.completed:
        tip = max(tips, key=lambda each: tips[each])
        factor, unit = unit_scale("m")
        of = f" of {tip}, the largest" if len(tips) > 1 else f" of {tip}"
        sentences.append(f"RMS tip error{of}: {tips[tip] * factor:.3g} {unit}.")
    if result.completed:
        trusted = summary["status"].get("trusted", True)
        sentences.append(
            "Momentum and energy are balanced." if trusted else "The ledger is open: see the warnings."
        )
    return " ".join(sentence.replace("..", ".") for sentence in sentences)
