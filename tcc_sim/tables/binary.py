"""Tables in Parquet, MATLAB, MDF and TDMS files, read by optional packages, and written as Parquet and MATLAB files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tcc_sim.errors import InputError, one_line, require
from tcc_sim.tables.file_columns import TIME, FileColumns
from tcc_sim.trajectory import Floats

HDF5 = b"\x89HDF"
"""First bytes of an HDF5 file, such as one of MATLAB 7.3."""


def parquet_contents(path: Path) -> FileColumns:
    """Return the columns of a Parquet file; units are in the metadata of its fields, times may be date-times."""
    require("pyarrow", "a Parquet file")
    import pyarrow
    from pyarrow import parquet

    try:
        file = parquet.ParquetFile(path)
    except (pyarrow.ArrowException, OSError) as error:
        raise InputError(f"{path} cannot be read as Parquet: {error}") from None
    schema = file.schema_arrow
    units = [(field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace") for field in schema]
    stated = (schema.metadata or {}).get(b"hold", b"").decode("utf-8", "replace")
    hold = dict(pair.split(" ", 1) for pair in stated.split(",") if " " in pair)

    def numbers(chosen: Sequence[int], time: int | None, most: int) -> tuple[list[Floats], list[str]]:
        _check_rows(path, file.metadata.num_rows, most)
        names = [schema.names[j] for j in chosen]
        table = file.read(columns=names)
        return [_of_arrow(path, name, table.column(name)) for name in names], []

    return FileColumns(schema.names, units, numbers, ["Parquet"], hold)


def _of_arrow(path: Path, name: str, column: Any) -> Floats:
    """Return a column of Arrow as floats; date-times in seconds from the first one."""
    import pyarrow

    kind = column.type
    if pyarrow.types.is_timestamp(kind) or pyarrow.types.is_duration(kind):
        ticks = column.cast(pyarrow.int64()).to_numpy()
        per_second = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[kind.unit]
        ticks = np.asarray(ticks)
        first = ticks[np.isfinite(ticks)][:1]
        return np.asarray((ticks - (first[0] if len(first) else 0)) / per_second, dtype=np.float64)
    try:
        return np.asarray(column.cast(pyarrow.float64()).to_numpy(), dtype=np.float64)
    except (pyarrow.ArrowException, ValueError):
        raise InputError(f"{path}: column {one_line(name)} holds {kind}, no numbers") from None


def mat_contents(path: Path) -> FileColumns:
    """Return the vectors of a MATLAB file up to version 7, also those in structures, that are as long as the times."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    with path.open("rb") as stream:
        head = stream.read(520)
    if HDF5 in (head[:4], head[512:516]):
        raise InputError(f"{path} is a MATLAB file of version 7.3 (HDF5); save it with the option -v7")
    try:
        values = loadmat(path, squeeze_me=True, struct_as_record=False)
    except (MatReadError, NotImplementedError, ValueError, OSError, TypeError, KeyError, IndexError) as error:
        raise InputError(f"{path} cannot be read as a MATLAB file: {error}") from None
    arrays: dict[str, Any] = {}
    stated: dict[str, Mapping[str, str]] = {}
    for name, value in values.items():
        if name.startswith("__"):
            continue
        fields = getattr(value, "_fieldnames", None)
        if fields is not None and name in ("units", "hold"):
            stated[name] = {key: str(getattr(value, key)) for key in fields}
            continue
        for key, part in ([(name, value)] if fields is None else [(key, getattr(value, key)) for key in fields]):
            if isinstance(part, np.ndarray) and part.ndim == 1 and part.dtype.kind in "fiub":
                arrays[key if key not in arrays else f"{name}.{key}"] = part
    if not arrays:
        raise InputError(f"{path} has no vectors of numbers; a timetable must be saved as vectors")
    return _of_arrays(path, arrays, stated.get("units", {}), ["a MATLAB file"], stated.get("hold", {}))


def _of_arrays(path: Path, arrays: Mapping[str, Any], units: Mapping[str, str], read_as: list[str],
               hold: Mapping[str, str]) -> FileColumns:
    """Return the contents of arrays in memory."""
    names = list(arrays)

    def numbers(chosen: Sequence[int], time: int | None, most: int) -> tuple[list[Floats], list[str]]:
        rows = len(arrays[names[chosen[0] if time is None else time]])
        _check_rows(path, rows, most)
        for j in chosen:
            if len(arrays[names[j]]) != rows:
                raise InputError(f"{path}: {names[j]} has {len(arrays[names[j]])} values; the times have {rows}")
        return [np.array(arrays[names[j]], dtype=np.float64) for j in chosen], []

    return FileColumns(names, [units.get(name, "") for name in names], numbers, read_as, hold)


def _check_rows(path: Path, rows: int, most: int) -> None:
    if rows > most:
        raise InputError(f"{path}: it has more than {most} rows; it must have at most {most}")


def _of_signals(path: Path, units: Mapping[str, str], signal: Callable[[str], tuple[Floats, Floats]],
                read_as: str) -> FileColumns:
    """Return the contents of signals with times of their own, which share one column of times: a cell is empty where a
    signal has no sample.

    units : unit by the name of the signal
    signal : function that returns times and values of a signal, in ascending order
    """
    names = [TIME, *units]

    def numbers(chosen: Sequence[int], time: int | None, most: int) -> tuple[list[Floats], list[str]]:
        signals = {j: signal(names[j]) for j in chosen if j}
        if not signals:
            raise InputError(f"{path}: no channel was chosen; --columns NAME=CHANNEL names one")
        t = np.unique(np.concatenate([stamps for stamps, _ in signals.values()]))
        _check_rows(path, len(t), most)
        columns = {0: t}
        for j, (stamps, values) in signals.items():
            columns[j] = np.full(len(t), np.nan)
            columns[j][np.searchsorted(t, stamps)] = values
        return [columns[j] for j in chosen], []

    return FileColumns(names, ["s", *units.values()], numbers, [read_as])


def mdf_contents(path: Path) -> FileColumns:
    """Return the channels of an MDF file, version 3 or 4 (.mf4, .mdf, .dat)."""
    require("asammdf", "an MDF file")
    from asammdf import MDF

    try:
        file = MDF(path)
    except Exception as error:  # Its exceptions have no common class.
        raise InputError(f"{path} cannot be read as an MDF file: {error}") from None
    masters = {(group, index) for group, index in file.masters_db.items()}
    places = {name: [place for place in entries if tuple(place) not in masters]
              for name, entries in file.channels_db.items()}

    def signal(name: str) -> tuple[Floats, Floats]:
        if len(places[name]) > 1:
            raise InputError(f"{path}: {len(places[name])} groups have a channel {one_line(name)}; export one of them")
        group, index = places[name][0]
        found = file.get(group=group, index=index)
        values = _floats(path, name, found.samples)
        invalid = getattr(found, "invalidation_bits", None)
        if invalid is not None and len(invalid) == len(values):
            values[np.asarray(invalid, dtype=bool)] = np.nan
        return np.asarray(found.timestamps, dtype=np.float64), values

    units = {}
    for name, entries in places.items():
        if entries and name not in (TIME, "time"):
            channel = file.groups[entries[0][0]].channels[entries[0][1]]
            unit = getattr(channel, "unit", "") or getattr(getattr(channel, "conversion", None), "unit", "")
            units[name] = str(unit or "").strip("\0 ")
    return _of_signals(path, units, signal, "MDF")


def _floats(path: Path, name: str, samples: Any) -> Floats:
    """Return the samples of a channel as numbers; InputError for text."""
    try:
        return np.array(samples, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{path}: channel {one_line(name)} holds no numbers") from None


def tdms_contents(path: Path) -> FileColumns:
    """Return the channels of a TDMS file: waveforms with their own times, or channels of one length, of which one has
    the times. A channel whose name another group has too is GROUP.CHANNEL.
    """
    require("nptdms", "a TDMS file")
    from nptdms import TdmsFile

    try:
        file = TdmsFile.read(path)
    except Exception as error:  # Its exceptions have no common class.
        raise InputError(f"{path} cannot be read as a TDMS file: {error}") from None
    channels: dict[str, Any] = {}
    for group in file.groups():
        for channel in group.channels():
            channels[channel.name if channel.name not in channels else f"{group.name}.{channel.name}"] = channel
    units = {name: str(channel.properties.get("unit_string", "")) for name, channel in channels.items()}
    waves = {name: channel for name, channel in channels.items() if channel.properties.get("wf_increment")}
    if not waves:
        arrays = {name: np.asarray(channel[:]) for name, channel in channels.items()}
        for name, values in arrays.items():
            if values.dtype.kind == "M":
                arrays[name] = (values - values[:1]) / np.timedelta64(1, "s")
        return _of_arrays(path, {name: values for name, values in arrays.items() if values.dtype.kind in "fiub"}, units,
                          ["TDMS"], {})
    starts = [channel.properties.get("wf_start_time") for channel in waves.values()]
    dated = all(start is not None for start in starts)

    def signal(name: str) -> tuple[Floats, Floats]:
        late = (waves[name].properties["wf_start_time"] - min(starts)) / np.timedelta64(1, "s") if dated else 0.0
        values = _floats(path, name, waves[name][:])
        # Rounded, so that samples of one instant in two waveforms share a row.
        return np.round(late + waves[name].time_track()[:len(values)], 9), values

    return _of_signals(path, {name: units[name] for name in waves if name not in (TIME, "time")}, signal, "TDMS")


def write_parquet(path: Path, columns: Mapping[str, Any], units: Mapping[str, str], hold: Mapping[str, str],
                  texts: Mapping[str, str]) -> None:
    """Write columns as Parquet, with units in the metadata of the fields, and holds and texts in those of the file."""
    import pyarrow
    from pyarrow import parquet

    fields = [pyarrow.field(name, pyarrow.array(np.asarray(values)).type, metadata={"unit": units.get(name, "")})
              for name, values in columns.items()]
    notes = {**texts, "hold": ",".join(f"{name} {how}" for name, how in hold.items())}
    schema = pyarrow.schema(fields, metadata={key: value for key, value in notes.items() if value})
    parquet.write_table(pyarrow.table([np.asarray(values) for values in columns.values()], schema=schema), path)


def write_mat(path: Path, columns: Mapping[str, Any], units: Mapping[str, str], hold: Mapping[str, str],
              texts: Mapping[str, str]) -> None:
    """Write columns as column vectors of a MATLAB file, with the structures `units` and `hold`, and texts.

    Names have _ in place of a point; texts in a column are cells.
    """
    from scipy.io import savemat

    def named(mapping: Mapping[str, Any]) -> dict[str, Any]:
        return {name.replace(".", "_"): value for name, value in mapping.items()}

    arrays = {name: np.asarray(values) for name, values in columns.items()}
    cells = {name: values.astype(object) for name, values in arrays.items() if values.dtype.kind == "U"}
    stated: Iterable[tuple[str, Mapping[str, str]]] = (("units", units), ("hold", hold))
    with path.open("wb") as stream:
        savemat(stream, {**named({**arrays, **cells}), **texts,
                         **{name: named(mapping) for name, mapping in stated if mapping}},
                oned_as="column", do_compression=True, long_field_names=True)


READERS: dict[str, Callable[[Path], FileColumns]] = {
    ".parquet": parquet_contents, ".pq": parquet_contents, ".mat": mat_contents, ".mf4": mdf_contents,
    ".mdf": mdf_contents, ".tdms": tdms_contents}
"""Reader by suffix."""
MDF = b"MDF "
"""First bytes of an MDF file, of which version 3 is often named .dat, as tables in text are."""


def reader_of(path: Path) -> Callable[[Path], FileColumns] | None:
    """Return the reader of a file; None for text."""
    if path.suffix.lower() == ".dat":
        with path.open("rb") as stream:
            if stream.read(len(MDF)) == MDF:
                return mdf_contents
    return READERS.get(path.suffix.lower())
