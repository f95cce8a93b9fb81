"""Reports of what presents itself by tables: margins in a folder, a batch in a file."""

import numpy as np
import pytest
import xarray as xr

import spacerobot as sr
from optim.evaluation import BatchResult
from spacerobot.common.errors import ResultError
from spacerobot.linear.loop_margins import FILE, UNITS
from spacerobot.result.events import event_table

PATH = "target.links.body.mass"


def write_margins(folder):
    values = {"gain_up": 6.0, "gain_down": -np.inf, "phase": 14.1, "disk": 0.25, "crossover": 1.6}
    loops = {name: [[values.get(name, 0.0), values.get(name, 0.5)]] for name in UNITS}  # delays 0 and 0.5 s
    data = xr.Dataset(
        {name: (("instant", "loop"), rows) for name, rows in loops.items()} | {"stable": ("instant", [True])},
        coords={
            "instant": ["2.5 s"],
            "loop": ["torque/arm/a<1>", "torque/arm/b"],
            "time": ("instant", [2.5]),
            "description": ("instant", ["continuous, 8 states"]),
        },
    )
    data.to_netcdf(folder / FILE)
    (folder / "figures").mkdir()
    (folder / "figures" / "bode_1.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    (folder / "figures" / "other.svg").write_text("<svg/>")


def test_margins_have_a_page_that_explains_a_delay_margin_of_zero(tmp_path):
    write_margins(tmp_path)
    sr.report(tmp_path, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "2.5 s: stable. The least disk margin is 0.250, of torque/arm/a&lt;1&gt;" in page
    assert page.index("In short") < page.index("2.5 s: continuous, 8 states")
    assert "torque/arm/a&lt;1&gt;" in page
    assert page.count("0*") == 2  # in one row, and in the note
    assert "any additional delay makes it unstable" in page
    assert page.count("<figure") == 1
    assert "each broken at its point, 2.5 s" in page
    assert [row[3] for row in sr.load(tmp_path).content()[0].rows] == ["0*", "0.5"]
    with pytest.raises(ResultError, match="name it alone"):
        sr.report([tmp_path, tmp_path], tmp_path / "page.html")
    xr.Dataset().to_netcdf(tmp_path / FILE)
    with pytest.raises(ResultError, match="holds no"):
        sr.report(tmp_path, tmp_path / "page.html")


def test_a_batch_has_a_page_with_each_quantity_over_what_varies(tmp_path):
    data = xr.Dataset(
        {
            "tip_error_rms": ((PATH, "tip_error_rms_of"), [[1e-3], [2e-3]], {"units": "m"}),
            "diverged_at": ((PATH,), [np.nan, np.nan]),
        },
        coords={PATH: [10.0, 20.0], "tip_error_rms_of": ["arm/tip"]},
    )
    BatchResult(data).save(tmp_path / "many.nc")
    sr.report(tmp_path / "many.nc", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<title>Batch: many" in page
    assert "0.001 .. 0.0015 .. 0.002" in page
    assert page.count("<figure") == 1


def test_a_column_of_events_that_is_empty_is_left_out():
    captured = {"time_s": 1.0, "kind": "captured", "who": "left", "relative_velocity_m_s": [1e-3, 0, 0]}
    table = event_table([captured, {"time_s": 2.0, "kind": "phase", "who": "stop"}])
    assert table.headings == ["time [s]", "event", "relative speed [mm/s]"]
    assert table.rows == [["1.000000", "left captured", "1"], ["2.000000", "stop begins", ""]]
