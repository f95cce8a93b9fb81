"""Derivatives of least costs by the design."""

import pytest

from optim.planning.formulation.formulate import formulate
from optim.planning.search.make_plan import make_plan
from optim.planning.solver.ipopt import solve
from optim.planning.studies.cost_sensitivities import cost_sensitivities
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.instant_functions import build_instants
from spacerobot.common.errors import ScenarioError

LIMIT = 0.6
COARSE = [("plan.intervals", 4), ("plan.tolerance", 1.0), ("plan.limits.base_rotation_deg", LIMIT)]
PATHS = {
    "robots.one.links.link_2.mass": 8.0,
    "robots.one.base.position.0": -0.5,
    "target.base.spin_deg.2": 2.0,
    "plan.limits.base_rotation_deg": LIMIT,
}


@pytest.fixture(scope="module")
def planned(reach):
    return make_plan(reach(*COARSE), backend="interpreted")


@pytest.mark.parametrize("path", list(PATHS))
def test_slopes_of_the_least_cost_are_those_of_plans_made_anew(reach, planned, path):
    value = PATHS[path]
    costs = []
    for factor in (1.0002, 0.9998):
        problem = formulate(reach(*COARSE, (path, factor * value)))
        program = CollocationProgram(
            problem, build_instants(problem, "interpreted"), planned.motion.lobatto, 4
        )
        again = solve(program, planned.solution.w, planned.solution)  # on the same branch of solutions
        assert again.converged
        costs.append(program.objective(again.w))
    difference = (costs[0] - costs[1]) / (4e-4 * value)
    assert cost_sensitivities(planned, [path])[path] == pytest.approx(difference, rel=1e-3)


def test_what_is_no_number_is_refused(planned):
    with pytest.raises(ScenarioError, match="allowed: a number"):
        cost_sensitivities(planned, ["name"])
