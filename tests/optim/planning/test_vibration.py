"""Plans of flexible scenes: modes at rest at the end, energy of vibration as a cost."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.linalg import expm

from optim.planning.formulation.instant_view import InstantView
from optim.planning.formulation.stage import DrivenCoordinates, Stage
from optim.planning.output.plan_folder import FOLLOWED, write
from optim.planning.search.make_plan import make_plan
from spacerobot.common.errors import ScenarioError
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

HUB, PANEL, SHARE, FREQUENCY = 10.0, 5.0, 1.8, 0.35
"""Masses [kg], participation factor [kg^(1/2)] along x, and clamped frequency [Hz]."""
WAY, TIME = 0.5, 4.0
# turns slowly: else the hub would turn its mode across the way
BODY = f"""<robot name="hub"><link name="hub"><inertial><mass value="{HUB}"/>
<inertia ixx="1" iyy="1" izz="5000" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
ROD = {
    "kind": "modes",
    "link": "hub",
    "mass": PANEL,
    "inertia": [1, 1, 1, 0, 0, 0],
    "frequencies": [FREQUENCY],
    "damping": [0.0],
    "participation": [[SHARE, 0, 0, 0, 0, 0]],
}


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    """Function of goals and costs that gives a hub with one mode, which comes to rest at another place."""
    folder = tmp_path_factory.mktemp("vibration")
    (folder / "hub.urdf").write_text(BODY)
    robot = {"urdf": "hub.urdf", "base": {"joint": "planar"}, "tips": {"hub": {}}, "flexible": {"own": ROD}}
    come = {"come": {"tip": "sat/hub", "position": [WAY, 0, 0]}, "rest": {"still": "sat"}}

    def scene(goals=None, costs=None, changes=()):
        plan = {
            "duration": TIME,
            "goals": come | (goals or {}),
            "costs": costs or {"base_wrench": 1},
            "limits": {"base_force": 50, "base_torque": 5},
            "intervals": 12,
            "tolerance": 1e-4,
        }
        document = {"robots": {"sat": robot}, "plan": plan, "simulation": {"duration": 2 * TIME}}
        file = folder / "hub.yaml"
        file.write_text(yaml.safe_dump(document))
        return load_scene(file, list(changes))

    return scene


QUIET = {"quiet": {"undeformed": "sat"}}


def linear():
    """State matrix and input of (x, x', h, h') under a force on the hub."""
    w = 2 * np.pi * FREQUENCY
    inertia = np.array([[HUB + PANEL, SHARE], [SHARE, 1.0]])
    a = np.zeros((4, 4))
    a[0, 1] = a[2, 3] = 1
    a[[1, 3], 2] = np.linalg.solve(inertia, [0, -(w**2)])
    b = np.zeros(4)
    b[[1, 3]] = np.linalg.solve(inertia, [1, 0])
    return a, b, w


def least_effort(weight=0.0, steps=4000):
    """Integrals of F^2 and of ``(h'^2 + w^2 h^2) / 2`` at the least weighted sum: a Hamiltonian system."""
    a, b, w = linear()
    cost = np.diag([0, 0, weight * w**2, weight]) / 2
    system = np.block([[a, -np.outer(b, b) / 2], [-2 * cost, -a.T]])  # F = -b p / 2
    whole = expm(system * TIME)
    end = np.array([WAY, 0, 0, 0])
    y = np.concatenate([np.zeros(4), np.linalg.solve(whole[:4, 4:], end)])
    step, values, energies = expm(system * TIME / steps), [], []
    for _ in range(steps + 1):
        values.append((b @ y[4:] / 2) ** 2)
        energies.append((y[3] ** 2 + (w * y[2]) ** 2) / 2)
        y = step @ y
    return np.trapezoid(values, dx=TIME / steps), np.trapezoid(energies, dx=TIME / steps)


def test_least_effort_between_two_rests_with_a_mode(moving, tmp_path):
    """Against the two-point boundary value problem; flown, the mode is at rest when the hub is."""
    found = make_plan(moving(QUIET), backend="interpreted")
    exact, _ = least_effort()
    assert found.cost == pytest.approx(exact, rel=1e-5)
    ends = {}
    for name, plan in (("quiet", found), ("free", make_plan(moving(), backend="interpreted"))):
        write(plan, tmp_path / name)
        changes = [("simulation.duration", 2 * TIME)]
        flown = simulate(load_scene(tmp_path / name / FOLLOWED, changes), backend="interpreted").data
        mode = np.abs(flown.modal_coordinate.values[:, 0])
        ends[name] = mode[flown.time.values > TIME].max() / mode.max()
    assert ends["quiet"] < 1e-4
    assert ends["free"] > 0.3


def test_meshes_resolve_a_mode_that_hardly_moves_the_hub(moving, tmp_path):
    changes = {
        "robots.sat.flexible.own.participation": [[0.05, 0, 0, 0, 0, 0]],
        "robots.sat.flexible.own.frequencies": [4 / TIME],
        "plan.tolerance": 1e-5,
        "plan.intervals": 3,
    }
    found = make_plan(moving(QUIET, changes=changes.items()), backend="interpreted")
    write(found, tmp_path)
    flown = simulate(
        load_scene(tmp_path / FOLLOWED, [("simulation.duration", 2 * TIME)]), backend="interpreted"
    ).data
    mode = np.abs(flown.modal_coordinate.values[:, 0])
    assert mode[flown.time.values > TIME].max() < 0.01 * mode.max()


def test_the_energy_of_vibration_is_a_cost(moving):
    weight = 1000.0
    found = make_plan(moving(QUIET, {"base_wrench": 1, "vibration": weight}), backend="interpreted")
    effort, energy = least_effort(weight)
    # at a minimum each part varies by first order in what the mesh leaves, their sum by second order
    assert found.cost == pytest.approx(effort + weight * energy, rel=1e-4)
    assert found.terms["vibration"] == pytest.approx(weight * energy, rel=1e-3)
    assert energy < 0.8 * least_effort()[1]


def test_the_energy_of_a_bending_boom_is_that_of_its_hinges(reach):
    """With what it carries: spring energy, and the mass matrix of its own joints."""
    boom = {"kind": "beam", "link": "link_1", "end": [0.5, 0, 0], "normal": [0, 0, 1], "segments": 2}
    scene = reach(("robots.one.flexible", {"own": boom | {"bending_stiffness": 60}}))
    stage = Stage.of(scene, DrivenCoordinates((), (), np.empty(0), ()))
    energy = ca.Function(
        "e", [stage.q, stage.v], [InstantView(stage, "plan").signal("vibration_energy")["total"]]
    )
    rng, model = np.random.default_rng(2), scene.model
    q = pin.integrate(model, scene.q, rng.normal(size=model.nv))
    v = rng.normal(size=model.nv)
    passive = next(body for body in scene.bodies if body.name == "one").passive
    assert len(passive) == 2
    own = [model.idx_vs[j] for j in passive]
    mass = pin.crba(model, model.createData(), q)
    places = [model.idx_qs[j] for j in passive]
    mass = np.triu(mass) + np.triu(mass, 1).T
    exact = v[own] @ mass[np.ix_(own, own)] @ v[own] / 2 + scene.stiffness[own] @ q[places] ** 2 / 2
    np.testing.assert_allclose(float(energy(q, v)), exact, rtol=1e-12)


@pytest.mark.parametrize(
    ("goals", "costs", "changes", "message"),
    [
        ({"own": {"undeformed": "sta"}}, None, [], "no flexible links of 'sta'; did you mean sat"),
        (QUIET, None, [("robots.sat.flexible", {})], "no flexible links of 'sat'"),
        ({}, {"vibration": 1}, [("robots.sat.flexible", {})], "there are no flexible links"),
    ],
)
def test_what_does_not_bend_is_refused(moving, goals, costs, changes, message):
    with pytest.raises(ScenarioError, match=message):
        make_plan(moving(goals, costs, changes), backend="interpreted")
