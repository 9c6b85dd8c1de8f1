"""Arrow tables, such as those of Parquet files, as columns."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fimpact.cases.errors import CaseError
from fimpact.cases.readers.columns import Column, Table, exact, narrow


def parquet(path: Path) -> Table:
    """Columns of a Parquet file."""
    from pyarrow.parquet import ParquetFile

    return arrow(ParquetFile(path).read(), path)


def arrow(table, path: Path, units: dict[str, str] | None = None) -> Table:
    """Columns of an Arrow table; a list of n numbers in every row is n columns, a struct one for each field.

    Raises:
        CaseError: two columns of one name.
    """
    narrow(table.column_names, path)
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
