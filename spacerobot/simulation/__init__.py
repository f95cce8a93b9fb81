"""Simulations: a scene in, a result out; the variants of the paper's scenario."""

from spacerobot.simulation.run import (
    STEP_ERROR_LIMIT,
    Backend,
    PreparedSimulation,
    Progress,
    SimulationRequest,
    prepare_simulation,
    sampled_steps,
    simulate,
    simulate_designs,
)

__all__ = [
    "STEP_ERROR_LIMIT",
    "Backend",
    "PreparedSimulation",
    "Progress",
    "SimulationRequest",
    "prepare_simulation",
    "sampled_steps",
    "simulate",
    "simulate_designs",
]
