"""Arrays of NPY, NPZ and MATLAB files as columns.

An array (n,) named a is the column ``a``; the shorter side of a 2-D array is taken as its columns ``a[0]``,
``a[1]``, ..., of one without a name ``[0]``, ``[1]``, ...; the entries of a MATLAB cell array are ``a{0}``, ``a{1}``,
...; fields of a struct ``a.field``.
"""

import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fimpact.cases.errors import CaseError
from fimpact.cases.readers.columns import MAX_BYTES, Column, Table, decimal, exact


def npy(path: Path) -> Table:
    """Columns of an NPY file: the fields of a structured array, or ``[0]``, ``[1]``, ... of a plain one."""
    values = np.load(path, mmap_mode="r", allow_pickle=False)
    if values.nbytes > MAX_BYTES:
        raise CaseError(f"data file {path} has {values.nbytes} bytes; allowed: {MAX_BYTES}; decimate it before")
    if values.dtype.names:
        return [column for name in values.dtype.names for column in _columns(name, values[name], path.name)]
    return list(_columns("" if np.squeeze(values).ndim > 1 else path.stem, values, path.name))


def npz(path: Path) -> Table:
    """Columns of an NPZ file. Pickled objects in it are refused, never loaded."""
    _bounded(path)
    with np.load(path, allow_pickle=False) as arrays:
        return [column for name in arrays.files for column in _columns(name, _safe(arrays, name, path), path.name)]


def _bounded(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > MAX_BYTES:
        raise CaseError(f"data file {path} unpacks to {size} bytes; allowed: {MAX_BYTES}; decimate it before")


def _safe(arrays, name: str, path: Path) -> np.ndarray:
    try:
        return arrays[name]
    except ValueError as error:
        if "allow_pickle" in str(error) or "Object arrays" in str(error):
            raise CaseError(
                f"data file {path}: array '{name}' holds pickled Python objects, which could run code and are never "
                "loaded; allowed: arrays of numbers; save it again without dtype=object"
            ) from None
        raise


def mat(path: Path) -> Table:
    """Columns of a MATLAB v5 file (or v4); objects of MATLAB classes are refused."""
    from scipy.io import loadmat

    try:
        variables = loadmat(path, squeeze_me=False, struct_as_record=True, chars_as_strings=True)
    except NotImplementedError:
        raise CaseError(
            f"data file {path} is MATLAB v7.3 (HDF5); allowed: v5 to v7; save it with save(..., '-v7')"
        ) from None
    named = {name: value for name, value in variables.items() if not name.startswith("__")}
    return [column for name, value in named.items() for column in _columns(name, value, path.name)]


def _columns(name: str, value: np.ndarray, group: str) -> Iterator[Column]:
    kind = getattr(value.dtype, "kind", "")
    if type(value).__name__ in ("MatlabOpaque", "MatlabObject", "MatlabFunction"):
        raise CaseError(
            f"data file {group}: '{name}' is an object of a MATLAB class, which is not data; allowed: numbers, "
            "structs and cells; save its numbers"
        )
    if value.dtype.names:
        for field in value.dtype.names:
            yield from _entries(f"{name}.{field}", value[field], group)
    elif kind == "O":
        yield from _cells(name, value, group)
    elif kind in "fiub":
        yield from _numeric(name, value, group)
    elif kind in "US":
        text = np.atleast_1d(value).ravel().astype(str)
        yield Column(name, group, text, np.zeros(text.size, bool))


def _entries(name: str, values: np.ndarray, group: str) -> Iterator[Column]:
    # A struct is a 1 x 1 array whose fields are object arrays: the common case has one entry and needs no index.
    if values.dtype.kind == "O" and values.size == 1:
        yield from _columns(name, np.asarray(values.item()), group)
    else:
        yield from _columns(name, values, group)


def _cells(name: str, values: np.ndarray, group: str) -> Iterator[Column]:
    for index, value in enumerate(values.ravel()):
        yield from _columns(f"{name}{{{index}}}", value if isinstance(value, np.ndarray) else np.asarray(value), group)


def _numeric(name: str, value: np.ndarray, group: str) -> Iterator[Column]:
    value = np.squeeze(value)
    if value.ndim <= 1:
        yield _column(name, np.atleast_1d(value), group)
    elif value.ndim == 2:
        rows = value if value.shape[0] >= value.shape[1] else value.T
        for index, column in enumerate(rows.T):
            yield _column(f"{name}[{index}]", column, group)


def _column(name: str, values: np.ndarray, group: str) -> Column:
    # Each by itself: counts beside a clock's nanoseconds are no nanoseconds.
    values = exact(values) if values.dtype.kind in "iu" else decimal(values)
    return Column(name, group, np.ascontiguousarray(values), np.zeros(len(values), bool))
