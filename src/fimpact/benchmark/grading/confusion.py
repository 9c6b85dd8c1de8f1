"""Who is taken for whom: planted effects against answered ones."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from fimpact.benchmark.grading.claim import NONE, UNNAMED
from fimpact.report.plotting.style import STYLE, WIDTH, write

SEVERAL = "several"


def confusion(cases: pd.DataFrame, stem: Path | str) -> None:
    """Draw the effects planted alone, and nothing, against the names answered, to `stem`.svg and `stem`.png.

    A cell's number counts cases; a dot marks those where the name is right and the site wrong.
    """
    alone = cases[cases.kind.isin(["single", "null"])]
    alone = alone.assign(planted=alone.planted.map(named))
    answered = alone.answer.map(named)
    rows = [*sorted(set(alone.planted) - {NONE}), *([NONE] if NONE in set(alone.planted) else [])]
    others = sorted(set(answered) - set(rows) - {NONE, SEVERAL, UNNAMED})
    columns = [*[r for r in rows if r != NONE], *others, NONE, UNNAMED, SEVERAL]
    counts = pd.crosstab(alone.planted, answered).reindex(index=rows, columns=columns, fill_value=0)
    misplaced = pd.crosstab(alone.planted, answered, values=_misplaced(alone), aggfunc="sum")
    misplaced = misplaced.reindex(index=rows, columns=columns).fillna(0)
    with plt.rc_context(STYLE):
        figure, ax = plt.subplots(figsize=(WIDTH, 1.6 + 0.145 * len(rows)))
        _cells(ax, counts.to_numpy(), misplaced.to_numpy())
        ax.set_xticks(range(len(columns)), [c.replace("_", " ") for c in columns], rotation=90, fontsize=6.5)
        ax.set_yticks(range(len(rows)), [r.replace("_", " ") for r in rows], fontsize=6.5)
        ax.set(xlabel="answered", ylabel="planted")
        right = int(alone.right.sum())
        ax.set_title(f"{right} of {len(alone)} cases answered exactly; dots: right effect, wrong site", fontsize=8.5)
        write(figure, stem)


def named(answer: str) -> str:
    """The effect's name in an answer, "none", "unnamed" or "several"."""
    return SEVERAL if {"+", ";"} & set(answer) else answer.split("@")[0]


def _misplaced(alone: pd.DataFrame) -> pd.Series:
    return (alone.answer.map(named) == alone.planted) & ~alone.right.astype(bool)


def _cells(ax, counts: np.ndarray, misplaced: np.ndarray) -> None:
    share = counts / np.maximum(counts.sum(1, keepdims=True), 1)
    ax.imshow(share, cmap="Blues", vmin=0, vmax=1.15, aspect="auto")
    for (row, column), count in np.ndenumerate(counts):
        if count:
            ink = "white" if share[row, column] > 0.6 else "black"
            ax.text(column, row, str(count), ha="center", va="center", fontsize=6, color=ink)
        if misplaced[row, column]:
            ax.plot(column + 0.32, row - 0.28, ".", color="#D55E00", markersize=3)
    ax.set_xticks(np.arange(counts.shape[1]) - 0.5, minor=True)
    ax.set_yticks(np.arange(counts.shape[0]) - 0.5, minor=True)
    ax.grid(which="minor", color="0.9", linewidth=0.4)
    ax.tick_params(which="both", length=0)
