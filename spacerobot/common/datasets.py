"""Datasets in netCDF files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath, staged

if TYPE_CHECKING:
    import xarray as xr


def write_dataset(data: xr.Dataset, path: StrPath) -> None:
    """Write a dataset atomically to a netCDF file.

    Raises:
        ResultError: If it cannot be written.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with staged(target.parent) as stage:
            data.to_netcdf(stage / target.name, engine="netcdf4")
            (stage / target.name).replace(target)
    except (OSError, RuntimeError) as fault:
        raise ResultError(f"cannot be written: {fault}", source=target) from None


def read_dataset(path: StrPath) -> xr.Dataset:
    """Dataset of a netCDF file, in memory.

    Raises:
        ResultError: If it cannot be read.
    """
    import xarray as xr

    source = Path(path)
    try:
        with xr.open_dataset(source, engine="netcdf4") as stored:
            return stored.load()
    except (OSError, ValueError, RuntimeError) as fault:
        raise ResultError(f"cannot be read: {fault}", source=source) from None
