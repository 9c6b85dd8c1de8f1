"""Tables and arrays on disk: written whole or not at all, in one number format, in one order."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fimpact.support.atomic_files import replacing

FLOAT = "%.9g"
ORDER = ["system", "method", "surface", "seed", "round"]


def read(path: str | Path) -> pd.DataFrame:
    """The table in the CSV file `path`."""
    return pd.read_csv(path)


def write(table: pd.DataFrame, path: str | Path) -> None:
    """Write `table` as CSV with nine significant digits."""
    with replacing(path) as draft:
        table.to_csv(draft, index=False, float_format=FLOAT, lineterminator="\n")


def write_arrays(arrays: dict[str, np.ndarray], path: str | Path) -> None:
    """Write named arrays as NPZ."""
    named: Any = arrays
    with replacing(path) as draft:
        np.savez_compressed(draft, **named)


def gather(paths: Iterable[str | Path], systems: Sequence[str], methods: Sequence[str]) -> pd.DataFrame:
    """One table from many, sorted by `ORDER` with systems and methods as listed.

    Rows that tie (the parameters of one estimate) keep the order in which the parts list them, so that the
    result does not depend on how the work was split.
    """
    rank = {"system": list(systems).index, "method": list(methods).index}
    table = pd.concat([read(path) for path in paths], ignore_index=True)
    keys = {key: table[key].map(rank.get(key, lambda value: value)) for key in ORDER if key in table}
    # lexsort is stable and takes its most important key last.
    return table.iloc[np.lexsort([keys[key] for key in reversed(keys)])].reset_index(drop=True)
