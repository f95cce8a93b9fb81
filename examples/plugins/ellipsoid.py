r"""A collision shape of one's own: an ellipsoid, as of a tank.

spacerobot run bounce --plugin ellipsoid.py \
    --set 'pads.fist={link: arm/tip, kind: ellipsoid, semi_axes: [0.05, 0.07, 0.09]}'
"""

from typing import Any, Literal

import casadi as ca

import spacerobot as sr
from spacerobot.elements import CollisionShape, SmoothTerm, Support, Vector, quantity


@sr.register
class Ellipsoid(CollisionShape):
    """Ellipsoid about its origin, its semi-axes along its own axes."""

    kind: Literal["ellipsoid"] = "ellipsoid"
    semi_axes: Vector = quantity("m", "semi-axes along x, y, z")

    @classmethod
    def support(cls, rotation: ca.SX, measures: ca.SX) -> Support:
        """Support function ``|diag(a) n|`` in own axes; distances of all pairs follow from it."""
        return Support(terms=(SmoothTerm(reach, rotation, measures),))

    def coal(self) -> Any:
        """Coal's ellipsoid; without this, the hull of many points of the surface."""
        import coal

        return coal.Ellipsoid(*self.semi_axes)


def reach(direction: ca.SX, semi_axes: ca.SX) -> ca.SX:
    """How far the ellipsoid reaches along a direction [m]."""
    return ca.norm_2(semi_axes * direction)
