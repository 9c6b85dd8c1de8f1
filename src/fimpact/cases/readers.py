"""Files and folders of measured data as named columns. Nothing here runs code of a file.

Text is in `texts`, arrays of NumPy and MATLAB in `arrays`, bags of ROS in `ros`, datasets of LeRobot in `lerobot`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fimpact.cases.errors import CaseError, listed, reason

SPAN = 100 * 86_400 * 10**9  # ns that float holds exactly: 100 days
SI = "SI"  # unit of a column whose format has SI units by convention
LARGEST = 4 << 30  # bytes of numbers in a file; more than this is a compressed bomb or needs decimation before
WIDEST = 10_000  # columns of a file


@dataclass(frozen=True)
class Column:
    """A column of a file: values (n,), numbers or text; absent (n,), True where the file has no value at all.

    group: what shares its rows and its time, such as a file or a topic. clock: whether these are times in s already.
    origin: its file, group and name there. rows: which of that file's it holds; None: all. unit: what the file says,
    `SI` where its format has SI units by convention, "" where it says nothing.
    """

    name: str
    group: str
    values: np.ndarray
    absent: np.ndarray
    clock: bool = False
    origin: tuple[str, ...] = ()
    rows: np.ndarray | None = None
    unit: str = ""

    @property
    def numbers(self) -> np.ndarray:
        """Row of each value in the file's column, (n,), from 0."""
        return np.arange(len(self.values)) if self.rows is None else self.rows

    def take(self, rows: np.ndarray) -> "Column":
        """The same column at some rows."""
        return replace(self, values=self.values[rows], absent=self.absent[rows], rows=self.numbers[rows])


Table = list[Column]


def read_table(path: Path) -> Table:
    """Every column of a file or folder; the ending of its name, or what is in the folder, says the format.

    Raises:
        CaseError: no such file, unknown format, or a file that is damaged or holds pickled objects.
    """
    kind, reader = _reader(path)
    if not path.exists():
        raise CaseError(f"data file {path} does not exist; put it there, correct `file`, or point to it with --data")
    try:
        where = str(path.resolve())
        return [replace(one, origin=(where, one.group, one.name)) for one in _narrow(reader(path), path)]
    except CaseError:
        raise
    except Exception as error:
        raise CaseError(
            f"data file {path} cannot be read as {kind}: {reason(error)}; "
            "it may be damaged or of another format; write it again"
        ) from None


def _narrow(table: Sequence, path: Path) -> Sequence:
    if len(table) > WIDEST:
        raise CaseError(f"data file {path} has {len(table)} columns; allowed: {WIDEST}; leave out what is not needed")
    return table


def files_of(path: Path) -> list[Path]:
    """List the files that are read of a data file or folder."""
    if not path.is_dir():
        return [path]
    patterns = ("meta/info.json", "data/**/*.parquet", "metadata.yaml", "*.mcap", "*.db3")
    return [file for pattern in patterns for file in sorted(path.glob(pattern))]


def exact(whole: np.ndarray) -> np.ndarray:
    """Whole numbers as float; of nanoseconds since 1970, which float cannot hold, the part since a midnight at most a
    hundred days before the first."""
    if not whole.size or np.abs(whole).max() < 1 << 53:
        return whole.astype(float)
    return (whole - whole[whole != 0][0] // SPAN * SPAN).astype(float)


def decimal(values: np.ndarray) -> np.ndarray:
    """Floats as they were written: a float32 is the shortest decimal that it stands for, so that 0.1 stays 0.1."""
    if values.dtype != np.float32:
        return values.astype(float)
    import pyarrow as pa

    return np.asarray(pa.array(values.ravel()).cast(pa.string()).cast(pa.float64())).reshape(values.shape)


def _reader(path: Path) -> tuple[str, Callable[[Path], Table]]:
    from fimpact.cases import arrays, lerobot, ros, texts

    if path.is_dir():
        if (path / "meta" / "info.json").is_file():
            return "a LeRobot dataset", lerobot.dataset
        if (path / "metadata.yaml").is_file():
            return "a ROS 2 bag", ros.bag
        raise CaseError(
            f"data folder {path} has neither meta/info.json (LeRobot) nor metadata.yaml (ROS 2 bag); allowed: one of "
            "these, or a file; name the file in it that is meant"
        )
    readers = dict.fromkeys((".csv", ".txt", ".tsv"), texts.csv)
    readers |= dict.fromkeys((".jsonl", ".ndjson", ".json"), texts.json_lines)
    readers |= {".parquet": _parquet, ".npy": arrays.npy, ".npz": arrays.npz, ".mat": arrays.mat}
    readers |= dict.fromkeys((".mcap", ".db3", ".bag"), ros.bag)
    ending = path.suffix.lower()
    if ending not in readers:
        raise CaseError(
            f"data file {path} is of an unknown format; {listed(readers, ending)}, a LeRobot dataset or a ROS 2 bag "
            "(folders); convert it"
        )
    return ending[1:], readers[ending]


def _parquet(path: Path) -> Table:
    from pyarrow import parquet

    return arrow(parquet.ParquetFile(path).read(), path)


def arrow(table, path: Path, units: dict[str, str] | None = None) -> Table:
    """Columns of an Arrow table; a list of n numbers in every row is n columns, a struct one for each field.

    Raises:
        CaseError: two columns of one name.
    """
    _narrow(table.column_names, path)
    columns = [
        one
        for name, values in zip(table.column_names, table.columns, strict=True)
        for one in _flat(name.strip(), values)
    ]
    names = [name for name, _ in columns]
    twice = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
    if twice:
        raise CaseError(f"data file {path} has two columns named '{twice[0]}'; rename one of them")
    units = units or {}
    return [Column(name, path.name, *_plain(values), unit=units.get(name, "")) for name, values in columns]


def _flat(name: str, values) -> Iterator[tuple[str, object]]:
    """Arrow arrays without lists and structs, with their names."""
    import pyarrow as pa
    from pyarrow import compute

    values = values.combine_chunks() if isinstance(values, pa.ChunkedArray) else values
    lists = pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list
    if pa.types.is_struct(values.type):
        for field, part in zip(values.type, values.flatten(), strict=True):
            yield from _flat(f"{name}.{field.name}", part)
    elif any(one(values.type) for one in lists):
        lengths = compute.unique(compute.list_value_length(values)).drop_null().to_pylist()
        if len(lengths) != 1:
            yield name, pa.array(["(lists of several lengths)"] * len(values))
            return
        for index in range(lengths[0]):
            yield from _flat(f"{name}[{index}]", compute.list_element(values, index))
    else:
        yield name, values


def _plain(values) -> tuple[np.ndarray, np.ndarray, bool]:
    """Numbers or text of an Arrow array, where it has none, and whether they are stamps of a clock, in s."""
    import pyarrow as pa

    absent = np.asarray(values.is_null())
    if pa.types.is_timestamp(values.type):
        values = values.cast(pa.timestamp("ns")).cast(pa.int64())
        return np.where(absent, np.nan, 1e-9 * exact(np.asarray(values.fill_null(0)))), absent, True
    if pa.types.is_integer(values.type):
        return np.where(absent, np.nan, exact(np.asarray(values.fill_null(0)))), absent, False
    if pa.types.is_string(values.type) or pa.types.is_large_string(values.type) or pa.types.is_dictionary(values.type):
        return np.array([str(value) for value in values.to_pylist()]), absent, False
    others = pa.types.is_nested, pa.types.is_binary, pa.types.is_date, pa.types.is_time, pa.types.is_duration
    if any(other(values.type) for other in others):
        return np.full(len(values), "(not a number)"), absent, False
    if pa.types.is_float32(values.type):  # as the decimal that it was written as
        values = values.cast(pa.string())
    return np.asarray(values.cast(pa.float64()).fill_null(np.nan), dtype=float), absent, False
