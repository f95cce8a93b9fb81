"""What ships is what the generators write, what the paper says, and valid by itself."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.shipped_urdfs.__main__ import SHIPPED
from benchmarks.shipped_urdfs.spatial import satellite_box_urdf, servicer_urdf
from spacerobot.common.errors import DescriptionError
from spacerobot.description import (
    PlanarBase,
    PlanarLink,
    find_urdf,
    planar_arm_urdf,
    read_description,
    rectangle_urdf,
    shipped_names,
)
from spacerobot.description.bodies import welded_bodies


def planar_model(urdf: str) -> pin.Model:
    return pin.buildModelFromXML(urdf, pin.JointModelPlanar())


def frame_placement(model: pin.Model, name: str, q: np.ndarray) -> pin.SE3:
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return data.oMf[model.getFrameId(name, pin.FrameType.BODY)].copy()


def test_every_shipped_file_is_regenerated_exactly() -> None:
    assert set(SHIPPED) <= set(shipped_names())  # those of missions are typed from publications
    for name, generate in SHIPPED.items():
        assert find_urdf(name).read_bytes().decode("utf-8") == generate(), name


# nothing is published of their shapes; where bodies meet is in the scenario's contacts
WITHOUT_COLLISIONS = {
    "docking_station.urdf",
    "docking_vehicle.urdf",
    "planar_detumble.urdf",
    "soft_chaser.urdf",
    "soft_target.urdf",
}


@pytest.mark.parametrize("name", shipped_names())
def test_shipped_file_is_valid_by_itself(name: str) -> None:
    path = find_urdf(name)
    description = read_description(path)
    assert description.warnings == ()
    assert yourdfpy.URDF.load(str(path)).validate()
    assert pin.buildModelFromUrdf(str(path)).name == description.name == path.stem
    shapes = [shape for link in description.links for shape in (*link.visuals, *link.collisions)]
    assert {shape.geometry.kind for shape in shapes} <= {"box", "cylinder", "sphere"}
    assert all(shape.rgba is not None for link in description.links for shape in link.visuals)
    solid = all(link.collisions for link in description.links if link.mass > 0)
    assert solid != (name in WITHOUT_COLLISIONS)


def test_planar_arm_is_the_papers_table_1() -> None:
    model = planar_model(planar_arm_urdf())
    assert [model.names[i] for i in range(2, model.njoints)] == [f"joint_{i}" for i in range(1, 9)]
    assert (model.nq, model.nv) == (12, 11)
    assert model.inertias[1].mass == 200
    assert model.inertias[1].inertia[2, 2] == 40
    assert not model.inertias[1].lever.any()
    for index in range(1, 9):
        inertia = model.inertias[index + 1]
        assert inertia.mass == 11.76
        assert inertia.inertia[2, 2] == (0.2153 if index % 2 else 0.0929)
        np.testing.assert_array_equal(inertia.lever, (0.175, 0, 0))
        np.testing.assert_array_equal(
            model.jointPlacements[index + 1].translation, (0.4 if index == 1 else 0.35, 0, 0)
        )
    joints = read_description(find_urdf("planar_arm")).joints
    assert {joint.damping for joint in joints if joint.kind != "fixed"} == {0.1}


@pytest.mark.parametrize(("yaw_deg", "sign", "tip_at"), [(0, 1, (0.729, 1.865)), (180, -1, (-0.729, 1.865))])
def test_tip_of_the_papers_posture(yaw_deg: float, sign: int, tip_at: tuple[float, float]) -> None:
    model = planar_model(planar_arm_urdf())
    q = pin.neutral(model)
    q[2:4] = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    q[4:] = sign * np.radians([40] * 4 + [-40] * 4)
    tip = frame_placement(model, "tip", q)
    np.testing.assert_allclose(tip.translation[:2], tip_at, atol=5e-4)
    assert tip.rotation[0, 0] == pytest.approx(math.cos(math.radians(yaw_deg)), abs=1e-12)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(d=st.floats(0.01, 10), alpha=st.floats(0, 89), mass=st.floats(0.1, 1e3), inertia=st.floats(1e-3, 1e3))
def test_rectangle_mates_lie_where_equations_14_and_15_put_them(
    d: float, alpha: float, mass: float, inertia: float
) -> None:
    model = planar_model(rectangle_urdf(d, alpha, mass, inertia))
    mates = [frame_placement(model, f"mate_{i}", pin.neutral(model)) for i in (1, 2)]
    reach = d * math.cos(math.radians(alpha))
    np.testing.assert_allclose(mates[0].translation, (-reach, 0, 0), atol=1e-14 * d)
    np.testing.assert_allclose(mates[1].translation, (reach, 0, 0), atol=1e-14 * d)
    for mate in mates:  # x points inwards
        np.testing.assert_allclose(mate.rotation[:, 0], -mate.translation / reach, atol=1e-12)
    assert model.inertias[1].mass == pytest.approx(mass, rel=1e-14)
    assert model.inertias[1].inertia[2, 2] == pytest.approx(inertia, rel=1e-14)


@settings(deadline=None, max_examples=20, derandomize=True)
@given(
    links=st.integers(1, 12),
    length=st.floats(0.05, 5),
    inertias=st.lists(st.floats(1e-3, 10), min_size=1, max_size=3),
    radius=st.floats(0.1, 3),
)
def test_planar_arm_of_any_size(links: int, length: float, inertias: list[float], radius: float) -> None:
    urdf = planar_arm_urdf(links, PlanarLink(length, inertia_kg_m2=inertias), PlanarBase(radius_m=radius))
    model = planar_model(urdf)
    tip = frame_placement(model, "tip", pin.neutral(model))
    np.testing.assert_allclose(tip.translation, (radius + links * length, 0, 0), rtol=1e-13)
    found = [model.inertias[i + 2].inertia for i in range(links)]
    np.testing.assert_allclose(
        [inertia[2, 2] for inertia in found], [inertias[i % len(inertias)] for i in range(links)], rtol=1e-14
    )
    for inertia in found:  # some distribution of mass has it
        principal = np.linalg.eigvalsh(inertia)
        assert principal[0] > 0
        assert principal[0] + principal[1] >= principal[2] * (1 - 1e-12)


@pytest.mark.parametrize("link", [(1e-3, 1e-6, 1e12), (1e3, 1e9, 1e-9), (1e3, 1e-6, 1e-9), (1e-3, 1e9, 1e12)])
def test_whatever_is_in_range_can_be_read(tmp_path: Path, link: tuple[float, float, float]) -> None:
    length, mass, inertia = link
    for urdf in (
        planar_arm_urdf(200, PlanarLink(length, mass, (inertia,)), PlanarBase(1e-6, 1e-9, 1e-3), damping=0),
        planar_arm_urdf(1, PlanarLink(length, mass, (inertia,)), PlanarBase(1e9, 1e12, 1e3), damping=1e6),
        rectangle_urdf(length, 89, mass, inertia, 1e-4),
        rectangle_urdf(length, 0, mass, inertia, 1e3),
    ):
        path = tmp_path / "made.urdf"
        path.write_text(urdf)
        assert all("only" in warning for warning in read_description(path).warnings)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"links": 0}, "links"),
        ({"links": 2.5}, "links"),
        ({"link": PlanarLink(length_m=-1.0)}, "link.length_m"),
        ({"link": PlanarLink(mass_kg=0.0)}, "link.mass_kg"),
        ({"link": PlanarLink(mass_kg=math.nan)}, "link.mass_kg"),
        ({"link": PlanarLink(inertia_kg_m2=())}, "link.inertia_kg_m2"),
        ({"link": PlanarLink(inertia_kg_m2=(1.0, -1.0))}, "link.inertia_kg_m2"),
        ({"base": PlanarBase(mass_kg=math.inf)}, "base.mass_kg"),
        ({"base": PlanarBase(inertia_kg_m2=0.0)}, "base.inertia_kg_m2"),
        ({"base": PlanarBase(radius_m=0.0)}, "base.radius_m"),
        ({"damping": -0.1}, "damping"),
        ({"name": 'a"b'}, "name"),
    ],
)
def test_planar_arm_refuses_what_is_out_of_range(arguments: dict[str, object], named: str) -> None:
    with pytest.raises(DescriptionError, match=f"^{named}: .* allowed|^{named}: .*needed"):
        planar_arm_urdf(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"half_diagonal_m": 0.0}, "half_diagonal_m"),
        ({"alpha_deg": 90.0}, "alpha_deg"),
        ({"alpha_deg": -1.0}, "alpha_deg"),
        ({"mass_kg": -20.0}, "mass_kg"),
        ({"inertia_kg_m2": math.nan}, "inertia_kg_m2"),
        ({"thickness_m": 0.0}, "thickness_m"),
    ],
)
def test_rectangle_refuses_what_is_out_of_range(arguments: dict[str, float], named: str) -> None:
    with pytest.raises(DescriptionError, match=f"^{named}: .* allowed"):
        rectangle_urdf(**arguments)


def test_servicer_has_two_arms_of_seven_joints() -> None:
    model = pin.buildModelFromXML(servicer_urdf(), pin.JointModelFreeFlyer())
    assert (model.nq, model.nv) == (21, 20)
    assert model.inertias[1].mass == 500
    for side, y in (("left", 0.45), ("right", -0.45)):
        assert all(model.existJointName(f"{side}_joint_{i}") for i in range(1, 8))
        tip = frame_placement(model, f"{side}_tip", pin.neutral(model))
        np.testing.assert_allclose(tip.translation, (0.75 + 2.05, y, 0), atol=1e-13)
        np.testing.assert_allclose(tip.rotation, np.eye(3), atol=1e-13)
    bodies = welded_bodies(*_parts("servicer"), "base")
    assert len(bodies) == 15
    assert all(3 <= body.mass <= 8 for body in bodies[1:])


def test_servicers_wrist_and_shoulder_are_spherical() -> None:
    """Joints 1 to 3 move the shoulder's centre not at all, joints 5 to 7 the wrist's centre not at all."""
    model = pin.buildModelFromXML(servicer_urdf())
    rng = np.random.default_rng(0)
    for side in ("left", "right"):
        first = model.getJointId(f"{side}_joint_1") - 1
        for joint, moving in ((2, slice(first, first + 3)), (6, slice(first + 4, first + 7))):
            q = rng.uniform(-1, 1, model.nq)
            centres = []
            for _ in range(3):
                q[moving] = rng.uniform(-1, 1, 3)
                data = model.createData()
                pin.forwardKinematics(model, data, q)
                centres.append(data.oMi[model.getJointId(f"{side}_joint_{joint}")].translation.copy())
            np.testing.assert_allclose(centres, [centres[0]] * 3, atol=1e-14)


def test_servicer_can_hold_the_box() -> None:
    """Closed-form two-link arm in the plane of the mounts: both tips meet their mates within all limits."""
    model = pin.buildModelFromXML(servicer_urdf())
    box = pin.buildModelFromXML(satellite_box_urdf())
    box_at = pin.SE3(np.eye(3), np.array([2.3, 0, 0]))
    q = np.zeros(model.nq)
    for side, sign in (("left", 1), ("right", -1)):
        wrist = np.array([2.3 - 1.0, sign * (0.5 + 0.25 - 0.45)])  # from the shoulder at x = 0.75 + 0.25
        cosine = (wrist @ wrist - 0.8**2 - 0.75**2) / (2 * 0.8 * 0.75)
        elbow = -sign * math.acos(cosine)
        shoulder = math.atan2(wrist[1], wrist[0]) - math.atan2(
            0.75 * math.sin(elbow), 0.8 + 0.75 * math.cos(elbow)
        )
        first = model.getJointId(f"{side}_joint_1") - 1
        q[[first + 1, first + 3, first + 5]] = shoulder, elbow, -sign * math.pi / 2 - shoulder - elbow
        tip = frame_placement(model, f"{side}_tip", q)
        mate = box_at * frame_placement(box, f"mate_{side}", np.zeros(0))
        np.testing.assert_allclose(tip.homogeneous, mate.homogeneous, atol=1e-12)
    assert np.all(np.abs(q) < model.upperPositionLimit)


def test_satellite_box_is_a_uniform_box() -> None:
    model = pin.buildModelFromXML(satellite_box_urdf(), pin.JointModelFreeFlyer())
    expected = pin.Inertia.FromBox(100, 1.0, 1.0, 1.2)
    np.testing.assert_allclose(model.inertias[1].inertia, expected.inertia, atol=1e-4)
    assert model.inertias[1].mass == 100


def _parts(name: str) -> tuple[tuple, tuple]:
    description = read_description(find_urdf(name))
    return description.links, description.joints
