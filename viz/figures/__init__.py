"""Figures: functions that return matplotlib figures, in one style, without a display."""

from viz.figures.approach import approach
from viz.figures.bands import bands, moving_components
from viz.figures.base_disturbance import disturbance
from viz.figures.bodies import base_motion, grip_forces, object_motion
from viz.figures.campaign import SampleSpread, distributions, robustness
from viz.figures.collect import draw_all, figure_kinds, save_figures
from viz.figures.contacts import contact_forces
from viz.figures.docking import docking
from viz.figures.joints import joints
from viz.figures.kind import FigureKind, figure
from viz.figures.ledger import ledger
from viz.figures.style import Drawing, to_bytes
from viz.figures.tips import orientation_errors, tip_errors, tip_paths
from viz.figures.tuning import convergence, data_profiles, running_times, sensitivities
from viz.figures.wheels import momentum_budget, wheels

__all__ = [
    "Drawing",
    "FigureKind",
    "SampleSpread",
    "approach",
    "bands",
    "base_motion",
    "contact_forces",
    "convergence",
    "data_profiles",
    "distributions",
    "disturbance",
    "docking",
    "draw_all",
    "figure",
    "figure_kinds",
    "grip_forces",
    "joints",
    "ledger",
    "momentum_budget",
    "moving_components",
    "object_motion",
    "orientation_errors",
    "robustness",
    "running_times",
    "save_figures",
    "sensitivities",
    "tip_errors",
    "tip_paths",
    "to_bytes",
    "wheels",
]
