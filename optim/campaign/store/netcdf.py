"""The netCDF file of a campaign: laid out, filled block by block, read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import xarray as xr

from optim.campaign.rollouts.evaluator import CampaignEvaluator, SampleTable
from optim.campaign.rollouts.series import BYTES_EACH, SignalRecording
from spacerobot.common.errors import ResultError, near_names
from spacerobot.common.files import StrPath

FORMAT = 2
DATA = "campaign.nc"
ROWS = 1024  # samples that the file keeps, and packs, together
BLOCK_BYTES = 32_000_000  # of series that are put together before they are written
PIECE_BYTES = 1_000_000  # of series that are packed together


def block_rows(sets: int, recording: SignalRecording) -> int:
    """Number of samples of a block: the largest power of two whose series fit into ``BLOCK_BYTES``.

    Args:
        sets: Number of sets of gains.
        recording: Recorded series.
    """
    fitting = max(1, BLOCK_BYTES // max(sets * recording.bytes_per_rollout, 1))
    return int(min(ROWS, 1 << (fitting.bit_length() - 1)))


def write_tables(
    path: Path,
    evaluator: CampaignEvaluator,
    tables: Iterator[tuple[int, SampleTable]],
    *,
    about: str,
    complete: bool,
) -> None:
    """Write a campaign's file.

    Args:
        path: The file.
        evaluator: Evaluator that made the tables.
        tables: Tables with their first sample, in order.
        about: Description of the run, in words.
        complete: Whether every sample is among them.
    """
    with netCDF4.Dataset(path, "w") as file:
        rows_of_block = block_rows(len(evaluator.gains), evaluator.recording)
        _define(file, evaluator, rows_of_block)
        file.setncatts({"format": FORMAT, "complete": int(complete), "about": about})
        for samples, table in blocks(tables, rows_of_block):
            at = len(file.dimensions["sample"])
            rows = slice(at, at + len(table))
            file["sample"][rows] = samples
            file["draw"][rows] = table.draws
            file["diverged_at"][rows] = table.diverged_at_s
            if table.gaps.shape[2]:
                file["gap"][rows] = table.gaps
            for metric in dict.fromkeys(column.metric for column in evaluator.columns):
                places = [i for i, column in enumerate(evaluator.columns) if column.metric == metric]
                file[metric][rows] = table.metrics[:, :, places]
            for name, values in table.series.items():
                file[name][rows] = values


def check_layout(path: Path, evaluator: CampaignEvaluator) -> None:
    """Refuse a file that lacks something of its campaign.

    Raises:
        ResultError: Naming what.
    """
    metrics = list(dict.fromkeys(column.metric for column in evaluator.columns))
    series = [one.name for one in evaluator.recording.series]
    names: dict[str, tuple[str, ...]] = {"draw": ("sample", "parameter"), "diverged_at": ("sample", "gains")}
    names |= {name: (name,) for name in ("sample", "parameter", "gains")}
    names |= {f"{name}_of": (f"{name}_of",) for name in (*metrics, *series)}
    names |= {metric: ("sample", "gains", f"{metric}_of") for metric in metrics}
    names |= {name: ("sample", "gains", "time", f"{name}_of") for name in series}
    if series:
        names["time"] = ("time",)
    if evaluator.max_gaps:
        names |= {"grasp": ("grasp",), "gap": ("sample", "gains", "grasp"), "max_gap": ("grasp",)}
    missing = []
    try:
        with netCDF4.Dataset(path) as file:
            for name, dims in names.items():
                if name not in file.variables:
                    missing.append(f"no variable {name!r}")
                elif file[name].dimensions != dims:
                    dimensions = ", ".join(file[name].dimensions)
                    missing.append(f"{name}: found the dimensions {dimensions}, allowed: {', '.join(dims)}")
                elif name in (*metrics, *series) and "units" not in file[name].ncattrs():
                    missing.append(f"{name}: no attribute 'units'")
    except (OSError, RuntimeError) as fault:
        raise ResultError(f"cannot be read: {fault}", source=path) from None
    if missing:
        raise ResultError(f"damaged: {missing[0]}; remove it and run the campaign again", source=path)


def is_complete(path: Path, count: int) -> bool:
    """Whether a file holds every sample."""
    if not path.is_file():
        return False
    try:
        with netCDF4.Dataset(path) as file:
            same = file.getncattr("format") == FORMAT
            return same and bool(file.getncattr("complete")) and len(file.dimensions["sample"]) == count
    except (OSError, RuntimeError, AttributeError, KeyError):
        return False


def load_campaign(folder: StrPath, series: Sequence[str] = ()) -> xr.Dataset:
    """Numbers of a campaign: its parameters, metrics and series by sample and set of gains.

    Args:
        folder: Folder that ``spacerobot campaign`` or :func:`optim.campaign.run_campaign` wrote.
        series: Names of the kept signals to read, each (sample, gains, time, component); they may be large.

    Raises:
        ResultError: If there is no campaign, it cannot be read, or it has no such series.
    """
    folder = Path(folder)
    path = folder / DATA
    if not path.is_file():
        raise ResultError(f"holds no campaign that can be read: no {DATA}", source=folder)
    try:
        with xr.open_dataset(path, engine="netcdf4") as lazy:
            series_names = [str(name) for name in lazy.data_vars if "time" in lazy[name].dims]
            left = [name for name in series_names if name not in series]
            unused = [f"{name}_of" for name in left] + ([] if set(series_names) - set(left) else ["time"])
            for name in series:
                if name not in series_names:
                    raise ResultError(
                        f"keeps no series {name!r}; {near_names(name, series_names)}", source=path
                    )
            data = lazy.drop_vars([*left, *(name for name in unused if name in lazy.variables)]).load()
    except (OSError, ValueError, RuntimeError) as fault:
        raise ResultError(f"cannot be read: {fault}", source=path) from None
    if data.attrs.get("format") != FORMAT:
        raise ResultError(
            f"written by another version: layout {data.attrs.get('format')}, this one reads {FORMAT}; "
            "run the campaign again in another folder",
            source=path,
        )
    return data


def blocks(
    tables: Iterator[tuple[int, SampleTable]], rows: int
) -> Iterator[tuple[np.typing.NDArray[np.int64], SampleTable]]:
    """Blocks of ``rows`` samples, from tables of any length; the last block may be shorter.

    Yields:
        tuple: Indices of the samples, and their table.
    """
    pending: list[tuple[np.typing.NDArray[np.int64], SampleTable]] = []
    count = 0
    for begin, table in tables:
        at = 0
        while at < len(table):
            part = slice(at, min(at + rows - count, len(table)))
            pending.append((np.arange(begin + part.start, begin + part.stop), table.part(part)))
            count, at = count + part.stop - part.start, part.stop
            if count == rows:
                yield _joined(pending)
                pending, count = [], 0
    if pending:
        yield _joined(pending)


def _joined(
    parts: Sequence[tuple[np.typing.NDArray[np.int64], SampleTable]],
) -> tuple[np.typing.NDArray[np.int64], SampleTable]:
    return np.concatenate([samples for samples, _ in parts]), SampleTable.joined(
        [table for _, table in parts]
    )


def _define(file: Any, evaluator: CampaignEvaluator, rows_of_block: int) -> None:
    """Dimensions and variables; ``sample`` has no limit."""
    file.createDimension("sample", None)
    axes = {"parameter": list(evaluator.campaign.parameters), "gains": list(evaluator.gains)}
    for column in evaluator.columns:
        axes.setdefault(f"{column.metric}_of", []).append(column.where)
    for one in evaluator.recording.series:
        axes[f"{one.name}_of"] = list(one.components)
    if evaluator.max_gaps:
        axes["grasp"] = list(evaluator.max_gaps)
    for axis, names in axes.items():
        file.createDimension(axis, len(names))
        file.createVariable(axis, str, (axis,))[:] = np.array(names, dtype=object)
    file.createVariable("sample", "i8", ("sample",), chunksizes=(ROWS,))

    def table(name: str, *others: str) -> Any:
        sizes = (ROWS, *(len(file.dimensions[axis]) for axis in others))
        return file.createVariable(name, "f8", ("sample", *others), zlib=True, complevel=1, chunksizes=sizes)

    table("draw", "parameter")
    table("diverged_at", "gains").units = "s"
    if evaluator.max_gaps:
        table("gap", "gains", "grasp").units = "m"
        largest = file.createVariable("max_gap", "f8", ("grasp",))
        largest[:], largest.units = list(evaluator.max_gaps.values()), "m"
    for metric, unit in {column.metric: column.unit for column in evaluator.columns}.items():
        table(metric, "gains", f"{metric}_of").units = unit
    if evaluator.recording.series:
        # packed by whole blocks of samples and a few times, so that a moment of all samples is near
        times = evaluator.recording.time
        file.createDimension("time", len(times))
        time = file.createVariable("time", "f8", ("time",))
        time[:], time.units = times, "s"
        for one in evaluator.recording.series:
            width = len(one.components)
            few = max(1, min(len(times), PIECE_BYTES // (rows_of_block * width * BYTES_EACH)))
            dimensions, sizes = ("sample", "gains", "time", f"{one.name}_of"), (rows_of_block, 1, few, width)
            file.createVariable(one.name, "f8", dimensions, zlib=True, complevel=1, chunksizes=sizes)
            file[one.name].units = one.unit
