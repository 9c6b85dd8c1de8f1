"""The table of graded cases, `cases.csv`."""

from pathlib import Path

import pandas as pd

FLAGS = (
    "detected located right partly in_set place_right mode_right both_in_set resolved_designed resolved_random".split()
)


def read_cases(path: Path | str) -> pd.DataFrame:
    """The table `cases.csv`; its flags are True, False or missing.

    Raises:
        ValueError: a column is missing, or a flag is neither.
    """
    # "null" is a kind of case here, not a missing value.
    table = pd.read_csv(path, keep_default_na=False, na_values=[""], dtype={"case": str, "size": str})
    for flag in FLAGS:
        if flag not in table:
            raise ValueError(f"{path} has no column {flag}; `snakemake concealed` writes one that has")
        values = table[flag].astype("string").map({"True": True, "False": False})
        if (values.isna() & table[flag].notna()).any():
            raise ValueError(f"{path}: {flag} must be True, False or empty; make the table anew")
        table[flag] = values.astype(object) if values.isna().any() else values.astype(bool)
    if "odd_named" in table:
        table["odd_named"] = table.odd_named.astype("string").map({"True": True, "False": False}).astype(object)
    return table


def of_kinds(cases: pd.DataFrame, *kinds: str) -> pd.DataFrame:
    """The rows of these kinds of cases."""
    return cases[cases.kind.isin(kinds)]
