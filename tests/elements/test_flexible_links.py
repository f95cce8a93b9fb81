"""Flexible links: closed forms of beams and of hybrid cantilevered modes, rigid limit, what sees them."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.linalg import eigh
from scipy.optimize import brentq

import spacerobot as sr
from optim.planning.formulation.stage import DrivenCoordinates, Stage
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.linear import linearise
from spacerobot.quantities import Context, find_quantity
from spacerobot.rollout import Measures, Signals, build_rollout, final
from spacerobot.scenario.load import validate
from spacerobot.scene import build_scene

LENGTH, DENSITY, STIFFNESS = 5.0, 4.0, 2000.0
MASS = LENGTH * DENSITY
ROD = MASS * LENGTH**2 / 12
HUB = 120.0
URDF = f"""<robot name="boomed"><link name="hub"><inertial><mass value="{HUB}"/>
  <inertia ixx="50" iyy="60" izz="70" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="beam"><inertial><origin xyz="{LENGTH / 2} 0 0"/><mass value="{MASS}"/>
  <inertia ixx="60" iyy="{ROD}" izz="{ROD}" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><origin xyz="{LENGTH / 2} 0 0"/><geometry><box size="{LENGTH} 1 0.1"/></geometry></visual>
  <collision><origin xyz="{LENGTH / 2} 0 0"/><geometry><box size="{LENGTH} 1 0.1"/></geometry></collision>
  </link>
<joint name="weld" type="JOINT"><parent link="hub"/><child link="beam"/><origin xyz="0.5 0.1 0"/>
  <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="1"/></joint>
<link name="end"/><joint name="tip" type="fixed"><parent link="beam"/><child link="end"/>
  <origin xyz="{LENGTH} 0 0"/></joint>
<link name="arm"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="hub"/><child link="arm"/><origin xyz="-0.5 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="5" velocity="1"/></joint></robot>"""
BOOM = {"kind": "beam", "link": "beam", "end": [LENGTH, 0, 0], "bending_stiffness": STIFFNESS}
PLANE = BOOM | {"normal": [0, 0, 1]}
PANEL = {
    "kind": "modes",
    "link": "beam",
    "position": [0.2, -0.1, 0.3],
    "rotation_deg": [20, -30, 40],
    "frequencies": [0.3],
    "damping": [0.01],
}


SQUARE = PANEL | {"position": [0, 0, 0], "rotation_deg": [0, 0, 0]}


@functools.cache
def folder():
    found = tempfile.TemporaryDirectory(prefix="flexible_")
    for kind, name in (("fixed", "boomed"), ("revolute", "hinged")):
        (Path(found.name) / f"{name}.urdf").write_text(URDF.replace("JOINT", kind), encoding="utf-8")
    return found


def scene_of(flexible, base="fixed", urdf="boomed", changes=(), **robot):
    """A hub with a beam; the second joint of the URDF is driven by nothing unless told otherwise."""
    section = {"urdf": f"{urdf}.urdf", "base": {"joint": base}, "tips": {"end": {}}, **robot}
    document = {
        "name": "flexible",
        "robots": {"sat": section | ({"flexible": {"own": flexible}} if flexible else {})},
        "simulation": {"duration": 1.0, "step": 0.005, "output_step": 0.1},
    }
    source = Path(folder().name) / "scenario.yaml"
    source.write_text(yaml.safe_dump(document), encoding="utf-8")
    return build_scene(validate(document, source=source), dict(changes), source=source)


def inertia_of(scene):
    mass = pin.crba(scene.model, scene.model.createData(), scene.q)
    return np.triu(mass) + np.triu(mass, 1).T


def frequencies(scene):
    """Of the oscillations about rest [rad/s], from the linearised closed loop."""
    (found,) = linearise(scene, backend="interpreted")
    return np.sort([abs(mode.pole) for mode in found.modes if mode.pole.imag > 1e-3])


def roots_of_beam(equation, guesses):
    """Angular frequencies [rad/s] of a beam from the roots of its characteristic equation."""
    lambdas = np.array([brentq(equation, a, b) for a, b in guesses])
    return lambdas**2 * np.sqrt(STIFFNESS / DENSITY) / LENGTH**2


def test_cantilever_frequencies_are_eulers_and_bernoullis_of_second_order():
    """1 + cos x cosh x = 0."""
    exact = roots_of_beam(lambda x: 1 + np.cos(x) * np.cosh(x), [(1, 3), (4, 6)])
    errors = np.array(
        [np.abs(frequencies(scene_of(PLANE | {"segments": n}))[:2] / exact - 1) for n in (6, 12)]
    )
    np.testing.assert_allclose(errors[0] / errors[1], 4, rtol=0.1)
    assert errors[1, 0] < 2e-3


def test_hinges_bend_about_both_axes_across_the_beam():
    scene = scene_of(BOOM | {"segments": 3}, base="free_flyer")
    passive = scene.bodies[0].passive
    assert [scene.model.names[joint] for joint in passive[:3]] == ["sat/own_1a", "sat/own_1b", "sat/own_2a"]
    stiffness = scene.stiffness[[scene.model.idx_vs[joint] for joint in passive]]
    np.testing.assert_allclose(stiffness, np.full(6, STIFFNESS * 3 / LENGTH))
    whole = inertia_of(scene_of(None, base="free_flyer"))
    np.testing.assert_allclose(inertia_of(scene)[:6, :6], whole[:6, :6], atol=1e-10)


def test_torsional_frequencies_of_a_clamped_beam():
    """(2 k - 1) pi / (2 l) sqrt(G J / m_p), m_p being the polar inertia by the length; of second order."""
    twisting = 70.0
    section = PLANE | {"bending_stiffness": 1e9, "torsional_stiffness": twisting}
    exact = np.array([1, 3]) * np.pi / (2 * LENGTH) * np.sqrt(twisting / (60 / LENGTH))
    errors = []
    for n in (4, 8):
        scene = scene_of(section | {"segments": n})
        errors.append(np.abs(frequencies(scene)[:2] / exact - 1))
    np.testing.assert_allclose(errors[0] / errors[1], 4, rtol=0.1)
    assert errors[1].max() < 2e-2
    whole = inertia_of(scene_of(None, base="free_flyer"))
    own = section | {"segments": 3, "torsional_inertia": 7.0}
    np.testing.assert_allclose(inertia_of(scene_of(own, "free_flyer"))[:6, :6], whole[:6, :6], atol=1e-10)
    piece = next(link for link in scene_of(own).bodies[0].description.links if link.name == "own_3")
    assert piece.inertia[0, 0] == pytest.approx(7 * LENGTH / 6)


@pytest.mark.parametrize("n", [1, 4])
def test_static_deflection_of_the_end(n):
    """Under a uniform load: w l^4 / (8 E I), of a chain of n segments less by a closed form."""
    scene = scene_of(PLANE | {"segments": n}, changes={"gravity": [0, -1e-4, 0]})
    stiffness = scene.stiffness
    passive = [scene.model.idx_vs[joint] for joint in scene.bodies[0].passive]
    load = pin.computeGeneralizedGravity(scene.model, scene.model.createData(), scene.q)
    q = pin.neutral(scene.model)
    q[passive] = -load[passive] / stiffness[passive]
    loop = build_closed_loop(scene)
    x0, c = loop.setup(loop.parameter_values)
    x = x0.full().ravel()
    x[: scene.model.nq] = q
    rates = loop.dynamics(0, x, loop.at(0, x, c)).full().ravel()[scene.model.nq :][: scene.model.nv]
    assert np.abs(rates[passive]).max() < 1e-9
    outputs = dict(zip(loop.outputs.name_out(), loop.outputs(0, x, loop.at(0, x, c)), strict=True))
    places = (np.arange(n) + 0.5) * LENGTH / n  # moments w (l - x)^2 / 2 at the hinges, levers l - x
    exact = -1e-4 * DENSITY * np.sum((LENGTH - places) ** 3 / 2) * LENGTH / n / STIFFNESS
    np.testing.assert_allclose(outputs["deflection"].full()[1], exact, rtol=1e-9)  # x: second order
    whole = -1e-4 * DENSITY * LENGTH**4 / (8 * STIFFNESS)
    np.testing.assert_allclose(exact, whole, rtol=1 / n**2)


@pytest.mark.parametrize("base", ["planar", "free_flyer"])
def test_a_light_hub_raises_the_frequencies_as_free_beams(base):
    """Against finite elements with Hermite's cubics on a free rigid hub."""
    exact = free_beam()
    flexible = PLANE if base == "planar" else BOOM
    found = frequencies(scene_of(flexible | {"segments": 12}, base))
    found = found[found > 1][:: 1 if base == "planar" else 2][0]
    np.testing.assert_allclose(found, exact, rtol=2e-2)
    assert exact > 1.05 * roots_of_beam(lambda x: 1 + np.cos(x) * np.cosh(x), [(1, 3)])[0]


def free_beam(elements=12):
    """Lowest bending frequency [rad/s] in the x-y plane of the beam clamped to the free hub.

    Nodes have (y, slope); the hub's motion moves the first one, y = Y + 0.5 theta. Motion along x and the
    offset of 0.1 m couple with bending through the hub alone: x = X - 0.1 theta.
    """
    dx = LENGTH / elements
    size = 2 * (elements + 1)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    shape_mass = np.array(
        [
            [156, 22 * dx, 54, -13 * dx],
            [22 * dx, 4 * dx**2, 13 * dx, -3 * dx**2],
            [54, 13 * dx, 156, -22 * dx],
            [-13 * dx, -3 * dx**2, -22 * dx, 4 * dx**2],
        ]
    )
    bending = np.array(
        [
            [12, 6 * dx, -12, 6 * dx],
            [6 * dx, 4 * dx**2, -6 * dx, 2 * dx**2],
            [-12, -6 * dx, 12, -6 * dx],
            [6 * dx, 2 * dx**2, -6 * dx, 4 * dx**2],
        ]
    )
    for i in range(elements):
        own = slice(2 * i, 2 * i + 4)
        mass[own, own] += DENSITY * dx / 420 * shape_mass
        stiffness[own, own] += STIFFNESS / dx**3 * bending
    # coordinates X, Y, theta of the hub, elbow angle, free nodes
    spread = np.zeros((size, 4 + size - 2))
    spread[0, 1], spread[0, 2], spread[1, 2] = 1, 0.5, 1
    spread[2:, 4:] = np.eye(size - 2)
    total = spread.T @ mass @ spread
    along = np.zeros(4 + size - 2)
    along[0], along[2] = 1, -0.1
    total += MASS * np.outer(along, along)
    total[0, 0] += HUB + 1
    total[1, 1] += HUB + 1
    total[2, 2] += 70 + 0.25
    total[1, 2] -= 0.5
    total[2, 1] -= 0.5
    elbow = np.zeros(4 + size - 2)
    elbow[2] = elbow[3] = 1
    total += np.outer(elbow, elbow)
    values = eigh(spread.T @ stiffness @ spread, total, eigvals_only=True)
    return np.sqrt(values[values > 1e-3][0])


MODES = {
    "an arm": [1.5, 0, 0, 0, 0, 4.0],
    "a short arm": [0, 2.0, 0, 0, 0, 0.05],
    "a pitch": [0.8, -0.5, 1.1, 1.0, -0.6, 1.4],
    "a pitch without an arm": [1.2, 0, 0, 0.9, 0, 0],
    "a couple": [0, 0, 0, 0.2, -0.1, 0.3],
}


@pytest.mark.parametrize("row", MODES.values(), ids=MODES)
def test_participation_factors_come_back_from_the_mass_matrix(row):
    """M = [D, L^T; L, 1] about the attachment: the rigid scene's D, and L as the structural model gave it."""
    section = PANEL | {"participation": [row]}
    scene = scene_of(section, "free_flyer")
    mass, rigid = inertia_of(scene), inertia_of(scene_of(None, "free_flyer"))
    joint = scene.bodies[0].passive[0]
    column = scene.model.idx_vs[joint]
    found = mass[:6, column] / np.sqrt(mass[column, column])
    at = pin.SE3(pin.rpy.rpyToMatrix(np.radians(PANEL["rotation_deg"])), np.array(PANEL["position"]))
    at = pin.SE3(np.eye(3), np.array([0.5, 0.1, 0])) * at
    np.testing.assert_allclose(found, at.act(pin.Force(np.array(row, dtype=float))).vector, atol=1e-12)
    others = [i for i in range(scene.model.nv) if i != column]
    np.testing.assert_allclose(mass[np.ix_(others, others)], rigid, atol=1e-11)


@pytest.mark.parametrize("row", MODES.values(), ids=MODES)
def test_frequency_of_a_mode_on_a_clamped_and_on_a_free_base(row):
    """w and its damping ratio as given; on a free base w / sqrt(1 - L D^-1 L^T), D that of everything."""
    section, w = PANEL | {"participation": [row]}, 2 * np.pi * PANEL["frequencies"][0]
    (found,) = linearise(scene_of(section), backend="interpreted")
    (mode,) = [mode for mode in found.modes if mode.pole.imag > 1e-3]
    np.testing.assert_allclose([abs(mode.pole), mode.damping], [w, 0.01], rtol=1e-9)
    scene = scene_of(section, "free_flyer")
    mass, column = inertia_of(scene), scene.model.idx_vs[scene.bodies[0].passive[0]]
    rigid, at = (
        inertia_of(scene_of(None, "free_flyer")),
        pin.rpy.rpyToMatrix(np.radians(PANEL["rotation_deg"])),
    )
    at = pin.SE3(at, np.add(PANEL["position"], [0.5, 0.1, 0]))
    share = np.zeros(len(rigid))  # the elbow is free as well
    share[:6] = at.act(pin.Force(np.array(row, dtype=float))).vector
    free = w / np.sqrt(1 - share @ np.linalg.solve(rigid, share))
    np.testing.assert_allclose(frequencies(scene), [free], rtol=1e-8)
    assert free > w
    assert mass[column, column] > 0


def test_an_appendage_that_no_urdf_has():
    """Attached to the hub: its mass is that of the rigid body, in any mode; it deflects by L a / w^2."""
    own = {"mass": 30.0, "com": [0, 2, 0], "inertia": [12, 1, 12, 0, 0, 0], "size": [1, 4, 0.05]}
    rows = [[0, 0, 4.0, 9.0, 0, 0], [3.5, 0, 0, 0, 0, -8.0]]
    section = (
        PANEL | own | {"link": "hub", "frequencies": [0.3, 0.5], "damping": [0, 0], "participation": rows}
    )
    scene = scene_of(section, "free_flyer", changes={"gravity": [0, 0, 1e-6]})
    total = sum(scene.model.inertias[joint].mass for joint in scene.bodies[0].subtree)
    np.testing.assert_allclose(total, HUB + MASS + 1 + 30)
    assert len(scene.bodies[0].passive) == 2
    loop = build_closed_loop(scene)
    names = [variable for variable in loop.variables if variable.name == "modal_coordinate"]
    assert names[0].labels == ("sat/own_mode_1", "sat/own_mode_2")


@pytest.mark.parametrize("flexible", [PLANE, PANEL | {"participation": [[1.5, 0, 0, 0, 0, 4.0]]}], ids=str)
def test_the_rigid_limit_is_of_first_order_in_the_compliance(flexible):
    """Poles of a hub turned by PD approach those of rigid links as 1 / (E I) or 1 / w^2."""
    held = {"controllers": {"hold": {"kind": "joint_pd", "kp": 3.0, "kd": 2.0}}}
    arguments = {"base": "free_flyer", "urdf": "hinged", **held}

    def slow(section):
        (found,) = linearise(scene_of(section, **arguments), backend="interpreted")
        return np.sort([mode.pole.real for mode in found.modes if 1e-2 < abs(mode.pole) < 3])[:1]

    (exact,), errors = slow(None), []
    for factor in (1e2, 1e3):
        stiff = {"bending_stiffness": STIFFNESS * factor} if flexible is PLANE else {}
        stiff = stiff or {"frequencies": [3 * float(np.sqrt(factor))]}
        errors.append(abs(slow(flexible | stiff)[0] - exact))
    np.testing.assert_allclose(errors[0] / errors[1], 10, rtol=0.05)
    assert errors[1] < 1e-3 * abs(exact)


def test_momentum_and_energy_of_a_free_flight():
    row = [[0.8, -0.5, 1.1, 1.0, -0.6, 1.4]]
    start = {"robots.sat.joints.own_mode_1.angle_deg": 2.0, "robots.sat.base.spin_deg": [3, -2, 5]}
    scene = scene_of(PANEL | {"participation": row, "damping": [0.02]}, "free_flyer", changes=start)
    loop = build_closed_loop(scene)
    options = {"duration_s": 2.0, "step_s": 0.01, "output_step_s": 0.2, "backend": "interpreted"}
    run = build_rollout(loop, **options).run()
    for kind in ("linear", "angular"):
        values = run.outputs[f"momentum_{kind}"]
        np.testing.assert_allclose(values, values[:1].repeat(len(values), axis=0), atol=1e-12)
    stored = sum(run.outputs[f"energy_{kind}"][:, 0] for kind in ("kinetic", "spring"))
    booked = sum(sign * run.outputs[f"work_{name}"][:, 0] for name, sign in loop.works.items())
    np.testing.assert_allclose(stored - stored[0], booked, atol=1e-10)
    assert run.outputs["energy_spring"][0, 0] > 1e-4
    assert np.ptp(run.outputs["energy_spring"]) > 1e-4


def test_controllers_results_and_margins_see_the_driven_joints_alone():
    held = {"controllers": {"hold": {"kind": "joint_pd", "kp": 3.0, "kd": 2.0}}}
    scene = scene_of(PLANE | {"segments": 2}, "planar", "hinged", **held)
    (found,) = linearise(scene, backend="interpreted")
    driven = {name for name in found.inputs if name.startswith("torque")}
    assert driven == {"torque/sat/weld", "torque/sat/elbow"}
    result = sr.simulate(scene, backend="interpreted")
    assert result.data["joint"].values.tolist() == ["sat/elbow", "sat/weld"]
    assert result.data["deflection"].dims == ("time", "flexible", "axis")
    assert "q.sat/own_1a" in result.data["configuration"].values


def test_gradients_and_lanes_by_frequency():
    row = [[1.5, 0, 0, 0, 0, 4.0]]
    start = {"robots.sat.joints.own_mode_1.angle_deg": 2.0}
    loop = build_closed_loop(scene_of(PANEL | {"participation": row}, "free_flyer", changes=start))
    signals = Signals.of(loop)
    measures = Measures(signals, {"end": final(signals["modal_coordinate"])}, lambda r, p: {"x": r["end"][0]})
    options = {"duration_s": 0.5, "step_s": 0.05, "backend": "interpreted", "measures": measures}
    paths = ("robots.sat.flexible.own.frequencies.0", "robots.sat.flexible.own.damping.0")
    rollout = build_rollout(loop, **options)
    exact = rollout.value_and_gradient(wrt=paths)
    base = rollout.values()[rollout.indices(paths)]
    moved = 1e-4 * np.diag(base)
    ends = rollout.batch(paths, np.concatenate([base + moved, base - moved])).costs["x"]
    np.testing.assert_allclose(exact.gradients["x"], (ends[:2] - ends[2:]) / (2e-4 * base), rtol=1e-5)


@pytest.mark.parametrize("kind", ["deflection", "modal_coordinate"])
def test_sizes_of_deflections_are_quantities(kind):
    section = PLANE if kind == "deflection" else PANEL | {"participation": [[1.5, 0, 0, 0, 0, 4.0]]}
    joint = "own_4a" if kind == "deflection" else "own_mode_1"
    scene = scene_of(section, "free_flyer", changes={f"robots.sat.joints.{joint}.angle_deg": -2.0})
    loop = build_closed_loop(scene)
    signals = Signals.of(loop)
    found = find_quantity(f"{kind}_peak").components(Context(scene, loop, signals))
    x0, c = loop.setup(loop.parameter_values)
    seen = loop.outputs(0, x0, loop.at(0, x0, c))[loop.outputs.name_out().index(kind)]
    (value,) = ca.Function("value", [signals[kind]], [found.values])(seen).full().ravel()
    exact = 2 * LENGTH / 8 * np.sin(np.radians(1)) if kind == "deflection" else 4.0 * np.radians(2)
    np.testing.assert_allclose(value, exact, rtol=1e-9)


def test_plans_have_the_springs_and_dampers_in_their_dynamics():
    """The residual of a plan's instant vanishes at the closed loop's acceleration, nothing driven."""
    scene = scene_of(PLANE | {"segments": 2, "damping_time": 0.1}, "planar", "hinged")
    loop, model = build_closed_loop(scene), scene.model
    stage = Stage.of(scene, DrivenCoordinates((), (), np.empty(0), ()))
    x0, c = loop.setup(loop.parameter_values)
    x = x0.full().ravel()
    x[4 : model.nq] += np.random.default_rng(3).normal(size=model.nq - 4)
    x[model.nq : model.nq + model.nv] = np.random.default_rng(4).normal(size=model.nv)
    a = loop.dynamics(0, x, loop.at(0, x, c))[model.nq : model.nq + model.nv]
    balance = ca.Function("balance", [stage.q, stage.v, stage.a], [stage.balance])
    found = balance(x[: model.nq], x[model.nq : model.nq + model.nv], a).full()
    assert np.abs(scene.stiffness).max() > 100
    np.testing.assert_allclose(found, 0, atol=1e-9)


def test_shapes_are_cut_at_the_hinges():
    links = {link.name: link for link in scene_of(BOOM | {"segments": 2}).bodies[0].description.links}
    sizes = [links[name].visuals[0].geometry.size for name in ("beam", "own_1", "own_2")]
    np.testing.assert_allclose(sizes, [[LENGTH / 4, 1, 0.1], [LENGTH / 2, 1, 0.1], [LENGTH / 4, 1, 0.1]])
    centres = [links[name].visuals[0].placement[0, 3] for name in ("beam", "own_1", "own_2")]
    np.testing.assert_allclose(centres, np.array([1 / 8, 1 / 2, 7 / 8]) * LENGTH)


def test_a_contact_that_names_a_flexible_link_has_all_its_pieces():
    ball = {"kind": "sphere", "link": "sat/arm", "position": [-1, 0, 0], "radius": 0.1}
    touch = {"kind": "hunt_crossley", "between": ["sat/beam", "ball"], "stiffness": 1e4}
    changes = {"pads": {"ball": ball}, "contacts": {"touch": touch}}
    (contact,) = scene_of(BOOM | {"segments": 2}, changes=changes).contacts
    assert [first.label for first, _ in contact.pairs] == ["sat/beam", "sat/own_1", "sat/own_2"]


def test_shapes_of_an_appendage_move_with_its_first_mode():
    rows = [[0, 0, 4.0, 9.0, 0, 0], [3.5, 0, 0, 0, 0, -8.0]]
    own = {"mass": 30.0, "com": [0, 2, 0], "inertia": [12, 1, 12, 0, 0, 0], "size": [1, 4, 0.05]}
    two = {"frequencies": [0.3, 0.5], "damping": [0, 0], "participation": rows}
    description = scene_of(PANEL | own | two | {"link": "hub"}).bodies[0].description
    links = {link.name: link for link in description.links}
    assert [len(links[name].visuals) for name in ("own", "own_mode_1", "own_mode_2")] == [0, 1, 0]
    joint = next(joint for joint in description.joints if joint.name == "own_mode_1")
    placement = joint.origin @ links["own_mode_1"].visuals[0].placement
    np.testing.assert_allclose(placement[:3, 3], [0, 2, 0], atol=1e-12)
    whole = {
        link.name: link
        for link in scene_of(PANEL | {"participation": [[1.0, 0, 0, 0, 0, 0]]}).bodies[0].description.links
    }
    assert len(whole["beam"].visuals) == 1  # it carries a frame


@pytest.mark.parametrize(
    ("flexible", "told"),
    [
        (BOOM | {"torsional_inertia": 1}, "it belongs to `torsional_stiffness`"),
        (SQUARE | {"participation": [[0, 0, 0, 9.0, 0, 0]]}, "has, mostly about x: found 1.35 times"),
        (BOOM | {"mass_per_length": 4.5}, "more moves than link 'beam' has"),
        (BOOM | {"link": "bem"}, "no link 'bem' in boomed.urdf; did you mean"),
        (BOOM | {"normal": [1, 0, 0]}, "normal: found"),
        (BOOM | {"youngs_modulus": 7e10}, "bending_stiffness: give it, or both"),
        (PANEL | {"participation": [[1, 0, 0, 0, 0, 0]] * 2}, "participation: found 2, allowed: 1"),
        (PANEL | {"participation": [[0.0] * 6]}, "participation.0: found zeros alone"),
        (
            PANEL | {"participation": [[1.0] + [0.0] * 5], "shapes": [1]},
            "shapes: found 1, allowed: less than 1",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(flexible, told):
    with pytest.raises(ScenarioError) as fault:
        scene_of(flexible)
    assert told in str(fault.value)
    assert "robots.sat.flexible.own" in str(fault.value)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"mass_per_length": 0}, "robots.arm.flexible.two: link 'two_1a' is a moving link; it has no mass"),
        ({}, "robots.arm.flexible.two: more moves than link 'link_1' has"),
    ],
)
def test_two_beams_of_one_link_are_named(more, told):
    beam = {"kind": "beam", "link": "link_1", "start": [0, 0, 0], "end": [0.3, 0, 0], "segments": 2}
    beam |= {"bending_stiffness": 100, "normal": [0, 0, 1]} | more
    arm = {"urdf": "planar_arm.urdf", "base": {"joint": "planar"}, "flexible": {"one": beam, "two": beam}}
    with pytest.raises(ScenarioError) as fault:
        build_scene(validate({"robots": {"arm": arm}}))
    assert str(fault.value).startswith(told)
