"""Functional mock-up units (FMI 2.0 and 3.0): a scene's plant for co-simulation by other tools."""

from spacerobot.fmu.unit import build_fmu

__all__ = ["build_fmu"]
