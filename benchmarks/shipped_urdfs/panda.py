"""A published arm of seven joints, the Franka Emika Panda, with primitives in place of its meshes.

Lengths and limits are the maker's. Masses, centres of mass and inertias were identified on a real arm by
C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca, "Dynamic identification of the Franka Emika
Panda robot with retrieval of feasible parameters using penalty-based optimization", IEEE Robotics and
Automation Letters 4(4), 2019, as the maker's own description gives them. Shapes are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from spacerobot.description import xml_text as x

Triple = tuple[float, float, float]
_QUARTER = math.pi / 2
_FLANGE_M = 0.107  # from joint 7
_BASE = x.inertial(
    0.629769, (3.15e-3, 3.88e-3, 4.285e-3), (-0.041018, -1.4e-4, 0.049974), (8.2904e-7, 1.5e-4, 8.2299e-6)
)


@dataclass(frozen=True)
class _Link:
    """A link, the joint before it (about its z axis) and the cylinder along z that stands for its shape.

    Inertias are about the centre of mass in the link's axes: ixx, iyy, izz and ixy, ixz, iyz.
    """

    at_m: Triple
    roll_rad: float
    limits_rad: tuple[float, float]
    mass_kg: float
    com_m: Triple
    moments: Triple
    products: Triple
    from_m: float
    to_m: float


_LINKS = (
    _Link(
        (0, 0, 0.333),
        0.0,
        (-2.8973, 2.8973),
        4.970684,
        (3.875e-3, 2.081e-3, -0.04762),
        (0.70337, 0.70661, 9.117e-3),
        (-1.39e-4, 6.772e-3, 0.019169),
        -0.19,
        0.06,
    ),
    _Link(
        (0, 0, 0),
        -_QUARTER,
        (-1.7628, 1.7628),
        0.646926,
        (-3.141e-3, -0.02872, 3.495e-3),
        (7.962e-3, 0.02811, 0.025995),
        (-3.925e-3, 0.010254, 7.04e-4),
        -0.07,
        0.07,
    ),
    _Link(
        (0, -0.316, 0),
        _QUARTER,
        (-2.8973, 2.8973),
        3.228604,
        (0.027518, 0.039252, -0.066502),
        (0.037242, 0.036155, 0.01083),
        (-4.761e-3, -0.011396, -0.012805),
        -0.24,
        -0.06,
    ),
    _Link(
        (0.0825, 0, 0),
        _QUARTER,
        (-3.0718, -0.0698),
        3.587895,
        (-0.05317, 0.104419, 0.027454),
        (0.025853, 0.019552, 0.028323),
        (7.796e-3, -1.332e-3, 8.641e-3),
        -0.06,
        0.06,
    ),
    _Link(
        (-0.0825, 0.384, 0),
        -_QUARTER,
        (-2.8973, 2.8973),
        1.225946,
        (-0.011953, 0.041065, -0.038437),
        (0.035549, 0.029474, 8.627e-3),
        (-2.117e-3, -4.037e-3, 2.29e-4),
        -0.3,
        -0.06,
    ),
    _Link(
        (0, 0, 0),
        _QUARTER,
        (-0.0175, 3.7525),
        1.666555,
        (0.060149, -0.014117, -0.010517),
        (1.964e-3, 4.354e-3, 5.433e-3),
        (1.09e-4, -1.158e-3, 3.41e-4),
        -0.06,
        0.05,
    ),
    _Link(
        (0.088, 0, 0),
        _QUARTER,
        (-2.8973, 2.8973),
        0.735522,
        (0.010517, -4.252e-3, 0.061597),
        (0.012516, 0.010027, 4.815e-3),
        (-4.28e-4, -1.196e-3, -7.41e-4),
        0.06,
        _FLANGE_M,
    ),
)


def panda_arm_urdf(name: str = "panda_arm") -> str:
    """URDF of a Panda without its hand: links ``panda_link0`` to ``panda_link7`` and the frame ``tip``.

    Its root link is to be mounted on a bus. The frame ``tip`` lies at the flange, its x axis out of it.
    """
    links = x.link(
        "panda_link0",
        _BASE,
        x.visual_and_collision(x.cylinder(0.08, 0.14), "graphite", x.origin((0, 0, 0.07))),
    )
    joints: list[str] = []
    for i, part in enumerate(_LINKS, start=1):
        large = i <= 4
        place = x.origin((0, 0, (part.from_m + part.to_m) / 2))
        links += x.link(
            f"panda_link{i}",
            x.inertial(part.mass_kg, part.moments, part.com_m, part.products),
            x.visual_and_collision(
                x.cylinder(0.06 if large else 0.045, part.to_m - part.from_m), "white", place
            ),
        )
        joints += x.revolute(
            f"panda_joint{i}",
            f"panda_link{i - 1}",
            f"panda_link{i}",
            x.origin(part.at_m, (part.roll_rad, 0, 0)),
            x.Hinge(
                axis=(0, 0, 1),
                limit_rad=part.limits_rad,
                effort_n_m=87 if large else 12,
                velocity_rad_s=2.175 if large else 2.61,
                damping_n_m_s=0,
            ),
        )
    tip = x.link("tip", x.shape("visual", x.sphere(0.02), "mate"))
    mount = x.fixed("tip_mount", "panda_link7", "tip", x.origin((0, 0, _FLANGE_M), (0, -_QUARTER, 0)))
    return x.robot(name, " ".join((__doc__ or "").split()), links, joints, tip, mount)
