"""A small closed loop with what a rollout must handle: an angle pair, a quaternion, controller states."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

PARAMETERS = {
    "arm.kp": 4.0,
    "arm.kd": 0.6,
    "arm.inertia": 1.3,
    "arm.start": 0.4,
    "rotor.spin": 0.9,
    "rotor.offset": 0.2,
    "reference.turn": 1.0,
}


def toy_loop() -> SimpleNamespace:
    """A pendulum arm (cos, sin) under PID, whose swing torques a free rigid body (quaternion, body rates)."""
    p = ca.SX.sym("p", len(PARAMETERS))
    kp, kd, inertia, start, spin, offset, turn = ca.vertsplit(p)
    x0 = ca.vertcat(ca.cos(start), ca.sin(start), 0, 0, 0, 1, 0, spin, 0.3 * spin, -0.2, 0)
    setup = ca.Function(
        "setup", [p], [x0, ca.vertcat(kp, kd, 1 / inertia, offset, turn, turn)], ["p"], ["x0", "c"]
    )

    t, x, c = ca.SX.sym("t"), ca.SX.sym("x", 11), ca.SX.sym("c", 6)
    cos, sin, quaternion, rate, omega, memory = x[0], x[1], x[2:6], x[6], x[7:10], x[10]
    reference = ca.if_else(t < c[4], 0.5 * t**2, c[5] * (t - 0.5 * c[5]))
    error = reference * 0.3 - ca.atan2(sin, cos) + c[3]
    torque = c[0] * error - c[1] * rate + 2 * memory - 1.5 * sin
    imaginary, real = quaternion[:3], quaternion[3]
    qdot = ca.vertcat(0.5 * (real * omega + ca.cross(imaginary, omega)), -0.5 * ca.dot(imaginary, omega))
    body = ca.vertcat(2.0, 1.0, 0.7)
    wdot = (ca.cross(body * omega, omega) + ca.vertcat(0.1 * torque, 0, 0)) / body
    xdot = ca.vertcat(-sin * rate, cos * rate, qdot, torque * c[2], wdot, error)
    dynamics = ca.Function("dynamics", [t, x, c], [xdot], ["t", "x", "c"], ["xdot"])

    unit = ca.vertcat(x[0:2] / ca.norm_2(x[0:2]), quaternion / ca.norm_2(quaternion), x[6:])
    normalise = ca.Function("normalise", [x], [unit], ["x"], ["n"])
    outputs = ca.Function(
        "outputs",
        [t, x, c],
        [ca.vertcat(error, rate), torque, omega],
        ["t", "x", "c"],
        ["error", "torque", "omega"],
    )
    names = ("cos", "sin", "qx", "qy", "qz", "qw", "rate", "wx", "wy", "wz", "memory")
    return SimpleNamespace(
        parameter_paths=tuple(PARAMETERS),
        parameter_values=np.array(list(PARAMETERS.values())),
        state_names=names,
        nq=6,
        nv=4,
        nz=1,
        setup=setup,
        dynamics=dynamics,
        normalise=normalise,
        gaps=ca.Function("gaps", [p], [ca.SX(0, 1)], ["p"], ["gap"]),
        max_gaps={},
        outputs=outputs,
        jumps=(4,),
        switches=(),
        events=(),
        fine=(),
        tables=(),
        rows=ca.Function(),
        guards=ca.Function(),
        update=ca.Function(),
    )


@pytest.fixture(scope="session")
def loop():
    return toy_loop()
