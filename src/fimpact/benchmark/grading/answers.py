"""How right an answer is: precision and recall of (kind, place), sizes, and whether the odd effect is named.

An answer is a list of ``effect@place``. Where an effect has another as its special case, as friction that falls with
speed has friction that does not, that one at the same place is no mistake, and no answer for the whole either.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fimpact.benchmark.jsonl import read_rows
from fimpact.benchmark.truth import Planted, Truth
from fimpact.effects import EFFECTS

NOTHING, BETWEEN = "none", ";"
ENTERED = ["tool", "case", "answer", "precision", "recall", "heldout_after", "seconds"]  # columns of `entered.csv`
TOLD = 3.84  # non-centrality from which an oracle's own 95 % interval excludes zero
ALIKE = 0.2  # relative error of a size that is right


def names_of(answer: str) -> list[str]:
    """``effect@place`` of an answer that joins them by ; or +; nothing where it names nothing."""
    return [part for part in answer.replace("+", BETWEEN).split(BETWEEN) if "@" in part]


def listed(answer: str) -> str:
    """An answer as tables have it: its names joined by ; in alphabetical order."""
    return BETWEEN.join(sorted(answer.replace("+", BETWEEN).split(BETWEEN)))


def grade(truth: Truth, named: Collection[str], sizes: Mapping[str, float]) -> dict[str, Any]:
    """Columns precision, recall, odd_named and sizes_right of an answer.

    Args:
        named: ``effect@place`` of all that is answered. sizes: the amplitude of each, as far as one was stated.

    Returns:
        precision: share of what is named that is there, None where nothing is named. recall: of what is there and an
        oracle tells from zero, the share that is named; None where nothing is there or it has no name. odd_named: of
        crowds. sizes_right: share of the right names with a size within 20 %.
    """
    there = {_name(e): e for e in truth.effects if e.name in EFFECTS}
    accepted = _with_cases(there)
    right = [name for name in named if name in accepted]
    visible = [name for name, e in there.items() if e.lam > TOLD]
    odd = _name(truth.effects[-1]) if truth.kind == "crowd" else None
    sized = [_close(sizes[name], size_of(there[name])) for name in right if name in there and name in sizes]
    return {
        "precision": len(right) / len(named) if named else None,
        "recall": float(np.mean([_found(name, named, odd) for name in visible])) if visible else None,
        "odd_named": odd in named if odd else None,
        "sizes_right": float(np.mean(sized)) if sized else None,
    }


def _found(name: str, named: Collection[str], odd: str | None) -> bool:
    return name in (named if name == odd else _with_cases(named))


def _with_cases(names: Collection[str]) -> set[str]:
    """The names, and those of their special cases at the same place."""
    parts = [name.partition("@") for name in names]
    inner = {f"{case}@{place}" for kind, _, place in parts if kind in EFFECTS for case in EFFECTS[kind].contains}
    return set(names) | inner


def _name(effect: Planted) -> str:
    return f"{effect.name}@{effect.site}"


def _close(size: float, true: float) -> bool:
    return abs(size - true) <= ALIKE * abs(true)


def size_of(effect: Planted) -> float:
    """The planted amplitude, of several of one unit (sine and cosine, two directions) their norm; of a stranger, its
    first value."""
    return amplitude(effect.name, effect.values)


def amplitude(name: str, values: Mapping[str, float]) -> float:
    """The size of an effect with these values."""
    known = [c for c in EFFECTS[name].coefficients if not c.shape] if name in EFFECTS else []
    alike = [values[c.name] for c in known if c.unit == known[0].unit and c.name in values]
    return float(np.linalg.norm(alike)) if len(alike) > 1 else float(next(iter(values.values())))


def planted_name(effects: Sequence[Planted]) -> str:
    """``effect@site`` of all effects joined by ; in alphabetical order, none where there are none."""
    return BETWEEN.join(sorted(map(_name, effects))) or NOTHING


def gather_entered(parts: Iterable[str | Path]) -> pd.DataFrame:
    """Rows of all parts as `entered.csv`, sorted by tool and case."""
    rows = [row | {"case": row["of"]} for part in parts for row in read_rows(part).values()]
    table = pd.DataFrame(rows, columns=ENTERED)
    return table.sort_values(["tool", "case"], ignore_index=True)
