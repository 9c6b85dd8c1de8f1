"""Datasets of LeRobot, v2 and v3: a folder with ``meta/info.json`` and Parquet files of one or more episodes each.

A feature such as ``action`` is a list in every row; its entries are the columns ``action.shoulder_pan.pos``, ... by the
names that info.json gives them, else ``action[0]``, ... Images and videos are passed over.
"""

import json
import re
from dataclasses import replace
from pathlib import Path

from fimpact.cases.errors import CaseError
from fimpact.cases.readers.arrow_tables import arrow
from fimpact.cases.readers.columns import Column, Table

IMAGES = ("image", "video")


def dataset(path: Path) -> Table:
    """Columns of all episodes of a dataset, one below the other.

    Raises:
        CaseError: it has no Parquet files, or none of its features.
    """
    import pyarrow as pa
    from pyarrow import parquet

    info = json.loads((path / "meta" / "info.json").read_text(encoding="utf-8"))
    features = {name: one for name, one in info.get("features", {}).items() if one.get("dtype") not in IMAGES}
    files = [parquet.ParquetFile(file) for file in sorted(path.glob("data/**/*.parquet"))]
    if not files or not features:
        raise CaseError(
            f"LeRobot dataset {path} ({info.get('codebase_version', 'no version')}) has {len(files)} files "
            f"data/**/*.parquet and {len(features)} features of numbers in meta/info.json; allowed: v2.0 to v3.0, one "
            "or more of both; fetch its data, or convert it"
        )
    held = [file.read([name for name in features if name in file.schema_arrow.names]) for file in files]
    table = pa.concat_tables(held, promote_options="default")
    return [_named(column, features) for column in arrow(table, path)]


def _named(column: Column, features: dict) -> Column:
    """The column under the name that its feature gives its entry."""
    entry = re.fullmatch(r"(.+)\[(\d+)\]", column.name)
    if entry is None:
        return column
    names = _names(features.get(entry[1], {}).get("names"))
    if not names or [len(names)] != features[entry[1]].get("shape") or len(set(names)) < len(names):
        return column
    return replace(column, name=f"{entry[1]}.{names[int(entry[2])]}")


def _names(given) -> list[str]:
    """Names of the entries, which stand in a list, a list in a list, or a table of either."""
    if isinstance(given, dict):
        lists = [name for one in given.values() if isinstance(one, list) for name in one]
        return [str(name) for name in lists or given]
    if isinstance(given, list):
        return [name for one in given for name in (_names(one) if isinstance(one, list) else [str(one)])]
    return []
