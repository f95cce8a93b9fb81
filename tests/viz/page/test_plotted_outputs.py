"""Curves of the page come from what elements declare of their outputs."""

import pytest
import xarray as xr

from spacerobot.result import Result
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.page.signals import COMPOSED, TABULATED, quantities

SHORT = {"simulation.duration": 0.2}


@pytest.fixture(scope="module", params=["docking", "servicer-wheels", "bounce", "checkcase-10a"])
def result(request):
    return simulate(load_scene(request.param, SHORT), backend="interpreted")


def test_every_output_over_time_has_a_curve_or_declares_that_it_is_not_plotted(result):
    titles = {quantity.title for quantity in quantities(result)}
    for name, variable in result.data.data_vars.items():
        if (
            "time" in variable.dims
            and name not in (*(key for key, _ in TABULATED), *COMPOSED)
            and "sign" not in variable.attrs
        ):
            is_plotted = bool(variable.attrs.get("plotted", 1))
            assert (variable.attrs["long_name"] in titles) == is_plotted, name


def test_an_output_is_plotted_unless_it_declares_otherwise(result):
    one = xr.DataArray(result.data.time.values, dims="time", attrs={"units": "V", "long_name": "battery"})
    for plotted in (1, 0):
        data = result.data.assign(voltage=one.assign_attrs(plotted=plotted))
        titles = [quantity.title for quantity in quantities(Result(result.scenario, data, result.summary))]
        assert ("battery" in titles) == bool(plotted)
