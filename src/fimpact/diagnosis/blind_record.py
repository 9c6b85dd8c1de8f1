"""How often blind answers were right: the published counts of the benchmark, a row for each of its robots."""

import csv
from functools import cache
from importlib.resources import files

TABLE = "track_record.csv"  # as `snakemake concealed` wrote it; docs/benchmark.md says of which seed and commit


@cache
def rows() -> dict[str, dict[str, str]]:
    """Counts by robot."""
    text = files("fimpact.diagnosis").joinpath(TABLE).read_text(encoding="utf-8")
    return {row["rig"]: row for row in csv.DictReader(text.splitlines())}


def share_that_held(choice: bool) -> float:
    """Estimate the chance that an answer with names holds the truth, from all robots of the benchmark, whose
    differences are within what so few cases show (Laplace's rule of succession).

    Args:
        choice: whether the answer left one.
    """
    asked, good = ("choices", "held") if choice else ("certain", "right")
    count, right = (sum(int(row[column]) for row in rows().values()) for column in (asked, good))
    return (right + 1) / (count + 2)
