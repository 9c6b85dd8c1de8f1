"""How often "certain" is right, by stratum: rig, kind, non-centrality and concealment."""

from itertools import pairwise
from typing import Any

import pandas as pd
from scipy.stats import binomtest

SIZES = (0.0, 30.0, 300.0, 3000.0, float("inf"))  # edges of non-centrality
VISIBLE = 30.0  # non-centrality from which an oracle sees an effect
DEPTHS = (-float("inf"), 0.5, 0.9, float("inf"))  # edges of concealment
BY = {"system": "rig", "kind": "kind", "lambda": "lambda", "kappa": "concealment"}


def strata(cases: pd.DataFrame) -> pd.DataFrame:
    """A row for each stratum that has cases, and for each rig, kind, size and concealment alone ("all" elsewhere).

    Args:
        cases: a row per case, as `score` writes them.

    Returns:
        rig, kind, lambda, concealment, cases, certain (how many answers are), right (of those; in a crowd: whose every
        name is there), share, low, high (Wilson, 95 %).
    """
    told = cases.assign(**{"lambda": _bands(cases["lambda"], SIZES), "kappa": _bands(cases.kappa, DEPTHS)})
    told = told.assign(certain=_certain(cases), good=_good(cases)).rename(columns=BY)
    names = list(BY.values())
    groupings = [[], *([name] for name in names), ["rig", "kind"], names]
    rows = [_row(dict(key), own, names) for by in groupings for key, own in _parts(told, by)]
    return pd.DataFrame(rows)


def _bands(values: pd.Series, edges: tuple[float, ...]) -> pd.Series:
    labels = [f"{max(low, 0):g} to {high:g}" for low, high in pairwise(edges)]
    return pd.cut(values.astype(float), edges, right=False, labels=labels).astype(str)


def _certain(cases: pd.DataFrame) -> pd.Series:
    alone = ~cases.answer_set.astype(str).str.contains("|", regex=False)
    return alone & (cases.answer != "unnamed")


def _good(cases: pd.DataFrame) -> pd.Series:
    whole = cases.precision.astype(float) == 1 if "precision" in cases else False
    return cases.right.astype(bool) | ((cases.kind == "crowd") & whole)


def _parts(told: pd.DataFrame, by: list[str]):
    if not by:
        return [((), told)]
    return [(zip(by, key, strict=True), own) for key, own in told.groupby(by, sort=True)]


def _row(key: dict[str, str], own: pd.DataFrame, names: list[str]) -> dict:
    sure = own[own.certain]
    right = int(sure.good.sum())
    row: dict[str, Any] = {name: key.get(name, "all") for name in names}
    row |= {"cases": len(own), "certain": len(sure), "right": right}
    if not len(sure):
        return row | dict.fromkeys(("share", "low", "high"))
    interval = binomtest(right, len(sure)).proportion_ci(method="wilson")
    return row | {"share": right / len(sure), "low": interval.low, "high": interval.high}


def track_record(cases: pd.DataFrame) -> pd.DataFrame:
    """What the page of a diagnosis cites: a row per rig.

    Args:
        cases: a row per case, as `score` writes them.

    Returns:
        rig, cases; certain (answers that name something and leave no choice), right (of those, in every name); choices
        (other answers with names), held (of those, by one of their members); visible (cases that an oracle sees), found
        (of those).
    """
    named = ~cases.answer.isin(("none", "unnamed"))
    sure, good = named & _certain(cases), _good(cases)
    choice, held = named & ~sure, cases.in_set.fillna(False).astype(bool) | good
    clear = (cases.kind != "null") & (cases["lambda"].astype(float) >= VISIBLE)
    told = pd.DataFrame(
        {
            "rig": cases.system,
            "cases": 1,
            "certain": sure,
            "right": sure & good,
            "choices": choice,
            "held": choice & held,
            "visible": clear,
            "found": clear & cases.detected.fillna(False).astype(bool),
        }
    )
    return told.groupby("rig", sort=True).sum().astype(int).reset_index()
