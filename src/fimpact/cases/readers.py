"""Files of measured data as named columns: CSV, Parquet, NPZ, MATLAB v5, MCAP. Nothing here runs code of a file."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fimpact.cases.errors import CaseError, listed, reason

SPAN = 100 * 86_400 * 10**9  # ns that float holds exactly: 100 days
LARGEST = 4 << 30  # bytes of numbers in a file; more than this is a compressed bomb or needs decimation before
WIDEST = 10_000  # columns of a file


@dataclass(frozen=True)
class Column:
    """A column of a file: values (n,), numbers or text; absent (n,), True where the file has no value at all.

    group: what shares its rows and its time, such as a file or a topic. clock: whether these are times in s already.
    origin: its file, group and name there. rows: which of that file's it holds; None: all.
    """

    name: str
    group: str
    values: np.ndarray
    absent: np.ndarray
    clock: bool = False
    origin: tuple[str, ...] = ()
    rows: np.ndarray | None = None

    @property
    def numbers(self) -> np.ndarray:
        """Row of each value in the file's column, (n,), from 0."""
        return np.arange(len(self.values)) if self.rows is None else self.rows

    def take(self, rows: np.ndarray) -> "Column":
        """The same column at some rows."""
        return replace(self, values=self.values[rows], absent=self.absent[rows], rows=self.numbers[rows])


Table = list[Column]


def read_table(path: Path) -> Table:
    """Every column of a file; the ending of its name says the format.

    Raises:
        CaseError: no such file, unknown format, or a file that is damaged or holds pickled objects.
    """
    reader = _reader(path)
    if not path.is_file():
        raise CaseError(f"data file {path} does not exist; put it there, correct `file`, or point to it with --data")
    try:
        return [replace(one, origin=(str(path.resolve()), one.group, one.name)) for one in _narrow(reader(path), path)]
    except CaseError:
        raise
    except Exception as error:
        raise CaseError(
            f"data file {path} cannot be read as {path.suffix.lower()[1:]}: {reason(error)}; "
            "it may be damaged or of another format; write it again"
        ) from None


def _narrow(table: Table, path: Path) -> Table:
    if len(table) > WIDEST:
        raise CaseError(f"data file {path} has {len(table)} columns; allowed: {WIDEST}; leave out what is not needed")
    return table


def exact(whole: np.ndarray) -> np.ndarray:
    """Whole numbers as float; of nanoseconds since 1970, which float cannot hold, the part since a midnight at most a
    hundred days before the first."""
    if not whole.size or np.abs(whole).max() < 1 << 53:
        return whole.astype(float)
    return (whole - whole[whole != 0][0] // SPAN * SPAN).astype(float)


def _reader(path: Path) -> Callable[[Path], Table]:
    from fimpact.cases import arrays, ros

    readers = {".csv": _csv, ".txt": _csv, ".tsv": _csv, ".parquet": _parquet, ".npz": arrays.npz, ".mat": arrays.mat}
    readers[".mcap"] = ros.mcap
    if path.suffix.lower() not in readers:
        raise CaseError(f"data file {path} is of an unknown format; {listed(readers, path.suffix)}; convert it")
    return readers[path.suffix.lower()]


def _csv(path: Path) -> Table:
    from pyarrow import csv

    with open(path, encoding="utf-8-sig", newline="") as file:
        header = file.readline()
    if not header.strip():
        raise CaseError(f"data file {path} is empty; its first line must name the columns; write it again")
    delimiter = max(",;\t", key=header.count)
    # Blank is "no sample"; the text nan stays a number that is not one, and is judged later.
    convert = csv.ConvertOptions(null_values=[""], strings_can_be_null=True)
    try:
        table = csv.read_csv(path, parse_options=csv.ParseOptions(delimiter=delimiter), convert_options=convert)
    except Exception as error:
        raise CaseError(
            f"data file {path}: {reason(error)}; every line must have as many cells as the first; "
            "the file may be truncated: complete it or remove the broken line"
        ) from None
    return _arrow(table, path)


def _parquet(path: Path) -> Table:
    from pyarrow import parquet

    return _arrow(parquet.ParquetFile(path).read(), path)


def _arrow(table, path: Path) -> Table:
    names = [name.strip() for name in table.column_names]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise CaseError(f"data file {path} has two columns named '{twice[0]}'; rename one of them")
    columns = zip(names, table.columns, strict=True)
    return [Column(name, path.name, *_plain(values.combine_chunks())) for name, values in columns]


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
    return np.asarray(values.cast(pa.float64()).fill_null(np.nan), dtype=float), absent, False
