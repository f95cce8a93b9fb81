"""Percentile bands of recorded series, read in blocks of time so that memory use is bounded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import netCDF4
import numpy as np

from optim.campaign.rollouts.series import BYTES_EACH
from optim.campaign.store.netcdf import DATA
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ResultError, near_names
from spacerobot.common.files import StrPath

AT_ONCE_BYTES = 128_000_000  # read at once
PERCENT = (0.0, 5.0, 50.0, 95.0, 100.0)


@dataclass(frozen=True)
class QuantileBands:
    """Percentile bands of a recorded signal over the samples under one set of gains.

    Attributes:
        name, unit: Name and unit of the signal.
        components: Label of each of the signal's c numbers.
        time: Times of recording (nt,) [s].
        least, low, median, high, greatest: Minimum, 5 %, 50 %, 95 % and maximum over the samples, each (nt,
            c). A diverged rollout counts until its divergence; NaN where no sample remains.
        left: Number of samples that have not diverged by each time (nt,).
        sample, sample_values: Index of a single sample, and its values over time (nt, c).
    """

    name: str
    unit: str
    components: tuple[str, ...]
    time: Array
    least: Array
    low: Array
    median: Array
    high: Array
    greatest: Array
    left: np.typing.NDArray[np.int64]
    sample: int
    sample_values: Array


def read_bands(folder: StrPath, name: str, gains: str, sample: int) -> QuantileBands:
    """Percentile bands of a series of a campaign.

    Args:
        folder: A campaign's store.
        name: Name of the signal.
        gains: Name of the set of gains.
        sample: Index of a sample whose values are also returned.

    Raises:
        ResultError: If the store cannot be read, or there is no such series, set of gains or sample.
    """
    folder = Path(folder)
    try:
        with netCDF4.Dataset(folder / DATA) as file:
            file.set_auto_mask(False)
            series_names = [str(key) for key, variable in file.variables.items() if variable.ndim == 4]
            if name not in series_names:
                raise ResultError(
                    f"keeps no series {name!r}; {near_names(name, series_names)}", source=folder
                )
            variable, time, which = (
                file[name],
                np.asarray(file["time"][:]),
                list(file["gains"][:]).index(gains),
            )
            samples, width = variable.shape[0], variable.shape[3]
            step = variable.chunking()[2]
            rows_at_once = step * max(1, AT_ONCE_BYTES // (samples * step * width * BYTES_EACH))
            percentiles = np.empty((len(PERCENT), len(time), width))
            left = np.empty(len(time), dtype=np.int64)
            for begin in range(0, len(time), rows_at_once):
                part = slice(begin, begin + rows_at_once)
                values = np.sort(variable[:, which, part, :], axis=0)  # what diverged is NaN, and comes last
                left[part] = np.isfinite(values[..., 0]).sum(axis=0)
                # percentiles of the first values, of which so many are left
                count = left[part]
                at = np.array(PERCENT)[:, None] / 100 * np.maximum(count - 1, 0)
                below = np.floor(at).astype(np.int64)
                above = np.minimum(below + 1, np.maximum(count - 1, 0))
                times = np.arange(values.shape[1])
                a, b = values[below, times], values[above, times]
                percentiles[:, part] = a + (at - below)[..., None] * (b - a)
            row = int(np.flatnonzero(file["sample"][:] == sample)[0]) if sample in file["sample"][:] else None
            if row is None:
                raise ValueError(f"no sample {sample}")
            least, low, median, high, greatest = percentiles
            of = tuple(map(str, file[f"{name}_of"][:]))
            sample_series = np.asarray(variable[row, which])
            return QuantileBands(
                name,
                str(variable.units),
                of,
                time,
                least,
                low,
                median,
                high,
                greatest,
                left,
                sample,
                sample_series,
            )
    except (OSError, RuntimeError, ValueError) as fault:
        raise ResultError(f"cannot be read: {fault}", source=folder / DATA) from None
