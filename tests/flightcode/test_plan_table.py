"""A plan in C: the follower agrees with SciPy's Hermite interpolation."""

import ctypes
import itertools
import subprocess

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import KroghInterpolator, lagrange

from spacerobot.api.results import PlanResult
from spacerobot.exports.export import export
from spacerobot.flightcode.package import FLAGS

NODES = np.array([0.0, 0.2763932022500210, 0.7236067977499790, 1.0])


def plan_data(jumps):
    generator = np.random.default_rng(3)
    ends = [0.0, 0.7, 1.5, 2.0]
    rows = [a + NODES * (b - a) for a, b in itertools.pairwise(ends)]
    times = np.concatenate(rows if jumps else [rows[0], *(row[1:] for row in rows[1:])])
    names = ["arm/one", "arm/two"]
    values = {
        key: generator.normal(size=(len(times), 2)) for key in ("joint_position", "joint_rate", "torque")
    }
    variables = {key: (("time", "joint"), value, {"units": "1"}) for key, value in values.items()}
    attributes = {"points": 4, "interpolation": "lobatto"}
    return xr.Dataset(variables, {"time": times, "joint": names}, attributes), rows


@pytest.mark.compiler
@pytest.mark.parametrize("jumps", [False, True])
def test_the_follower_interpolates_as_scipy_does(compiler, tmp_path, jumps):
    data, rows = plan_data(jumps)
    folder = export(PlanResult(data, {}), tmp_path / "code", "plan")
    assert (
        (folder / "plan.csv").read_text(encoding="utf-8").startswith("time [s],joint_position[arm/one] [1]")
    )
    library = folder / "plan.so"
    subprocess.run([compiler, *FLAGS, "-shared", "-fPIC", "plan.c", "-o", library], cwd=folder, check=True)
    plan = ctypes.CDLL(str(library))
    table = (ctypes.c_double * data.torque.size).in_dll(plan, "plan_torque")
    position, rate, force = (np.zeros(2) for _ in range(3))
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (position, rate, force)]
    step = 4 if jumps else 3
    for k, row in enumerate(rows):
        part = data.isel(time=slice(k * step, k * step + 4))
        for u in (0.05, 0.4, 0.9):
            time = row[0] + u * (row[-1] - row[0])
            plan.plan_motion_at(ctypes.c_double(time), *pointers[:2])
            plan.plan_force_at(ctypes.c_double(time), table, 2, pointers[2])
            for i in range(2):
                knots = np.repeat(row, 2)
                numbers = np.column_stack([part.joint_position[:, i], part.joint_rate[:, i]]).ravel()
                motion = KroghInterpolator(knots, numbers)
                assert position[i] == pytest.approx(float(motion(time)), abs=1e-10)
                assert rate[i] == pytest.approx(float(motion.derivative(time)), abs=1e-9)
                assert force[i] == pytest.approx(lagrange(row, part.torque.values[:, i])(time), abs=1e-9)
    plan.plan_motion_at(ctypes.c_double(5.0), *pointers[:2])
    plan.plan_force_at(ctypes.c_double(5.0), table, 2, pointers[2])
    np.testing.assert_allclose(position, data.joint_position.values[-1], atol=1e-12)
    assert not rate.any()
    assert not force.any()
