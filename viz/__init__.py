"""Pictures of a result: browser animation, figures, report.

The names below are loaded when they are first used. Each figure is a function of :mod:`viz.figures`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from spacerobot.lazy_names import lazy_names

if TYPE_CHECKING:
    from viz.figures import draw_all as draw_all
    from viz.figures import save_figures as save_figures
    from viz.page.live import LiveViewer as LiveViewer
    from viz.page.notebook import embed as embed
    from viz.page.page import animation_page as animation_page
    from viz.page.page import write_animation as write_animation
    from viz.record import write_recording as write_recording
    from viz.report.report import write_report as write_report

_HOME = {
    "LiveViewer": "viz.page.live",
    "animation_page": "viz.page.page",
    "draw_all": "viz.figures",
    "embed": "viz.page.notebook",
    "save_figures": "viz.figures",
    "write_animation": "viz.page.page",
    "write_recording": "viz.record",
    "write_report": "viz.report.report",
}
"""Where each name of the front door lives."""

__all__ = [*_HOME]  # noqa: PLE0604 (names that are loaded when used)
__getattr__, __dir__ = lazy_names(__name__, _HOME)
