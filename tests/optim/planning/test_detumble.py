"""Bodies that come to rest, by a wrench on their base."""

import numpy as np
import pytest
import yaml

from optim.planning.make import make_plan
from spacerobot.errors import ScenarioError
from spacerobot.scene import load_scene

BODY = {
    "name": "spin",
    "robots": {"body": {"urdf": "rectangle.urdf", "base": {"joint": "planar", "spin_deg": [0, 0, 10]}}},
    "plan": {
        "duration": {"lower": 1, "upper": 60},
        "goals": {"rest": {"still": "body"}},
        "costs": {"time": 1},
        "limits": {"base_torque": 0.01, "base_force": 1},
        "order": 4,
        "intervals": 4,
    },
}
"""A single body that turns about a principal axis."""
FIXED = [("robots.body.urdf", "short_arm.urdf"), ("robots.body.base", {"joint": "fixed"})]


@pytest.fixture(scope="module")
def spinning(tmp_path_factory):
    """Function of changes that gives the scene."""
    file = tmp_path_factory.mktemp("spin") / "spin.yaml"
    file.write_text(yaml.safe_dump(BODY))
    return lambda *changes: load_scene(file, list(changes))


def angular_momentum(scene):
    return scene.model.inertias[1].inertia[2, 2] * np.radians(10)


def test_least_time_about_a_principal_axis_is_momentum_over_torque(spinning):
    found = make_plan(spinning(), backend="interpreted")
    assert found.motion.duration_s == pytest.approx(angular_momentum(found.scene) / 0.01, rel=1e-6)
    np.testing.assert_allclose(found.motion.u[:, 2], -0.01, rtol=1e-5)
    np.testing.assert_allclose(found.motion.v[-1], 0, atol=1e-9)


def test_time_and_effort_are_traded_by_their_weights(spinning):
    """a T + b L^2 / T is least at T = L sqrt(b / a)."""
    changes = [("plan.costs", {"time": 2.0, "base_wrench": 3e3}), ("plan.limits.base_torque", 1)]
    found = make_plan(spinning(*changes), backend="interpreted")
    momentum = angular_momentum(found.scene)
    assert found.motion.duration_s == pytest.approx(momentum * np.sqrt(3e3 / 2), rel=1e-5)
    assert found.cost == pytest.approx(2 * momentum * np.sqrt(6e3), rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("plan.limits", {})], "takes its momentum of 0.3927 N m s; give `limits.base_torque`"),
        ([("plan.goals.rest.still", "bode")], "no body 'bode'"),
        (FIXED, "is fixed, so it is always at rest"),
        ([("plan.goals.rest.tip", "body/tip")], "take a `tip`, and nothing else does"),
    ],
)
def test_what_cannot_come_to_rest_is_refused(spinning, changes, message):
    with pytest.raises(ScenarioError, match=message) as fault:
        make_plan(spinning(*changes), backend="interpreted")
    assert fault.value.exit_code == 2
