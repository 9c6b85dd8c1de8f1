"""Columns: what every reader makes of a file, with numbers as they were written."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fimpact.cases.errors import CaseError

SPAN = 100 * 86_400 * 10**9  # ns that float holds exactly: 100 days
SI = "SI"  # unit of a column whose format has SI units by convention
MAX_BYTES = 4 << 30  # bytes of numbers in a file; more than this is a compressed bomb or needs decimation before
MAX_COLUMNS = 10_000  # columns of a file


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


def narrow(table: Sequence, path: Path) -> Sequence:
    """The `table`, if it has no more columns than a file may have. Raises CaseError."""
    if len(table) > MAX_COLUMNS:
        raise CaseError(
            f"data file {path} has {len(table)} columns; allowed: {MAX_COLUMNS}; leave out what is not needed"
        )
    return table


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
