"""Fronts of plans: their points, what is marked; who works, and interruptions, change nothing."""

import contextlib
import dataclasses

import casadi as ca
import distributed
import numpy as np
import pytest
from typer.testing import CliRunner

from optim.planning.output.front_folder import to_data
from optim.planning.search import solve_tasks
from optim.planning.search.make_plan import make_plan
from optim.planning.solver.ipopt import loaded_blas, one_thread
from optim.planning.studies.pareto_front import (
    FrontPoint,
    FrontRequest,
    _compared,
    bisection_order,
    make_front,
)
from spacerobot.cli.app import app
from spacerobot.common.errors import ScenarioError
from viz.figures.pareto_front import front as draw_front

QUICK = [("plan.intervals", 4), ("plan.tolerance", 1.0), ("plan.limits.torque", 5), ("plan.iterations", 40)]
OVER_TIME = [*QUICK, ("plan.duration", {"lower": 0.6, "upper": 5})]
THREE = FrontRequest(count=3)


@pytest.fixture(scope="module")
def swept(reach):
    return make_front(reach(*OVER_TIME), THREE, backend="interpreted")


def told(front):
    """All that is written of a front, but times."""
    data = to_data(front)
    for point in data["points"]:
        for solve in point.get("plan", {}).get("solver_runs", []):
            del solve["seconds"], solve["evaluations_s"]
    return data


@pytest.mark.parametrize("count", [2, 5, 9])
def test_every_point_begins_with_one_that_is_done(count):
    found = bisection_order(count)
    assert sorted(k for k, _ in found) == list(range(count))
    done = [k for k, _ in found]
    assert found[0][1] is None
    assert all(parent in done[:i] for i, (_, parent) in enumerate(found) if i)


def test_a_front_over_time_has_the_least_costs_of_its_durations(reach, swept):
    first, middle, last = swept.points
    assert first.status == "refused"
    assert "no plan was found: infeasible" in first.failure
    assert [p.values["time"] for p in (middle, last)] == pytest.approx([2.8, 5.0])
    cold = make_plan(reach(*OVER_TIME, ("plan.duration", 5)), backend="interpreted")
    assert last.plan.cost == pytest.approx(cold.cost, rel=1e-6)
    turns = cold.terms["base_rotation"]
    assert last.values["base_rotation"] == pytest.approx(np.sqrt(turns / 5), rel=1e-4)


def test_a_killed_front_goes_on_where_it_was(reach, swept, tmp_path, monkeypatch):
    asked = []

    def search(solver, request):
        asked.append(request.duration[0])
        if len(asked) == 3:
            raise KeyboardInterrupt
        return real(solver, request)

    real = solve_tasks.solve_request
    monkeypatch.setattr(solve_tasks, "solve_request", search)
    scene = reach(*OVER_TIME)
    with pytest.raises(KeyboardInterrupt):
        make_front(scene, THREE, backend="interpreted", folder=tmp_path)
    again = make_front(scene, THREE, backend="interpreted", folder=tmp_path)
    assert asked == pytest.approx([2.8, 2.8, 0.6, 0.6, 5.0])
    assert told(again) == told(swept)
    spoilt = max(tmp_path.iterdir())
    spoilt.write_bytes(spoilt.read_bytes()[:200])
    assert told(make_front(scene, THREE, backend="interpreted", folder=tmp_path)) == told(swept)
    assert len(asked) == 6


def test_a_front_is_the_same_on_dask(reach, swept, monkeypatch):
    @contextlib.contextmanager
    def here(_):
        with distributed.Client(
            processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None
        ) as c:
            yield c

    monkeypatch.setattr(solve_tasks, "connect", here)
    assert told(make_front(reach(*OVER_TIME), THREE, backend="interpreted", dask="x")) == told(swept)


def test_weights_are_swept_where_no_term_is_time(reach):
    names = ("torque", "base_rotation")
    front = make_front(reach(*QUICK), FrontRequest(names, 2), backend="interpreted")
    first, last = front.points
    assert first.values["torque"] < last.values["torque"]
    assert first.values["base_rotation"] > last.values["base_rotation"]
    ratios = [p.changes["plan.costs.torque"] / p.changes["plan.costs.base_rotation"] for p in front.points]
    assert ratios[0] / ratios[1] == pytest.approx(1000)


def test_what_another_point_beats_is_marked_and_drawn(swept):
    plan = swept.points[-1].plan
    values = [(1, 3), (2, 2), (2, 3), (3, 2)]
    points = [
        FrontPoint(f"point_{k}", {}, {"time": a, "base_rotation": b}, "efficient", "", plan)
        for k, (a, b) in enumerate(values)
    ]
    marked = _compared(points, ("time", "base_rotation"))
    assert [p.status for p in marked] == ["efficient", "efficient", "dominated", "dominated"]
    drawing = draw_front(to_data(dataclasses.replace(swept, points=(*marked, swept.points[0]))))
    (panel,) = drawing.axes
    legend = [text.get_text() for text in panel.get_legend().get_texts()]
    assert legend == ["on the front", "dominated", "refused"]


@pytest.mark.parametrize(
    ("changes", "names", "message"),
    [
        ([], ("time", "base_rotation"), "found 6 s; a front over time needs limits"),
        ([], ("torque", "joint_rate"), "plan.costs.joint_rate: has no weight"),
        ([], ("torque", "base_rotaton"), "did you mean base_rotation"),
        ([], ("torque", "torque"), "found 'torque' twice"),
    ],
)
def test_bad_fronts_are_refused_in_one_line(reach, changes, names, message):
    with pytest.raises(ScenarioError, match=message):
        make_front(reach(*changes), FrontRequest(names, 3), backend="interpreted")


def test_the_command_plans_a_front(reach, tmp_path):
    out = tmp_path / "front"
    options = [f"--set={path}={value}" for path, value in QUICK]
    asked = ["--backend", "interpreted", "--pareto", "torque,base_rotation", "--points", "2"]
    ran = CliRunner().invoke(app, ["plan", str(reach().source), *options, *asked, "--out", str(out)])
    assert ran.exit_code == 0, ran.output
    assert "RMS joint torque [N m]" in ran.output
    for name in ("front.json", "figures/front.png", "point_1/plan.nc", "point_2/followed.yaml"):
        assert (out / name).is_file()


def test_the_solvers_own_blas_uses_one_thread():
    x = ca.SX.sym("x")
    ca.nlpsol("loads_it", "ipopt", {"x": x, "f": x**2})
    with one_thread():
        assert [blas.openblas_get_num_threads() for blas in loaded_blas()] == [1]
