"""Signals of a result or a plan: scalar time series with names and units."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.tables import unit_of_joint

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class ScalarSignal:
    """Scalar signal over time.

    Attributes:
        variable: Name of the variable in the dataset, such as ``tip_error``.
        labels: Label in each dimension after time, such as ``("rpr1/tip", "x")``.
        unit: Unit, such as ``m``; ``1`` for a dimensionless signal.
        text: Description.
        values: Samples (nt,).
    """

    variable: str
    labels: tuple[str, ...]
    unit: str
    text: str
    values: Array

    @property
    def name(self) -> str:
        """Name of the signal: variable and labels, such as ``tip_error[rpr1/tip,x]``."""
        return f"{self.variable}[{','.join(self.labels)}]" if self.labels else self.variable


def time_variables(data: xr.Dataset) -> Iterator[tuple[str, xr.DataArray]]:
    """Iterate over names and values of the numeric variables over time, with time as the first dimension."""
    for name, variable in data.data_vars.items():
        if "time" in variable.dims and variable.dtype.kind in "fiub":
            yield str(name), variable.transpose("time", ...)


def signals(data: xr.Dataset) -> Iterator[ScalarSignal]:
    """Iterate over all scalar signals of a dataset, in its order.

    The unit of a joint's signal depends on the kind of the joint if the variable has units of both kinds,
    such as ``rad or m``.
    """
    kinds = dict(zip(data.joint.values, data.joint_kind.values, strict=True)) if "joint_kind" in data else {}
    for name, variable in time_variables(data):
        dims, units = variable.dims[1:], str(variable.attrs.get("units", "1"))
        labels = [[str(label) for label in data[dim].values] for dim in dims]
        columns = variable.values.reshape(len(variable), -1)
        text = str(variable.attrs.get("long_name", name))
        for column, label in enumerate(itertools.product(*labels)):
            kind = next(
                (kinds[one] for dim, one in zip(dims, label, strict=True) if dim == "joint" and one in kinds),
                None,
            )
            unit = units if kind is None else unit_of_joint(units, str(kind))
            yield ScalarSignal(name, label, unit, text, np.asarray(columns[:, column]))
