"""A diagnosis in words: short sentences, the certain said as certain, numbers with their intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fimpact.diagnosis.wording.certainty import CERTAIN, POSSIBLE, SLIGHT, Finding, numbers_worth_telling
from fimpact.effects.base import words

MANY = 3  # effects of a kind that are listed by place; more are counted


def value_in_words(row: dict[str, Any]) -> str:
    """``friction 0.0299 ± 0.0002 N m``; a ratio has no unit."""
    unit = "" if row["unit"] in ("1", "") else f" {row['unit']}"
    half = (row["high"] - row["low"]) / 2
    return f"{row['name'].replace('_', ' ')} {row['after']:.3g} ± {_one_digit(half)}{unit}"


def _one_digit(size: float) -> str:
    return f"{size:.1g}" if size < 10 else f"{round(size, -int(np.floor(np.log10(size)))):.0f}"


def effect_in_words(finding: Finding) -> str:
    """``coulomb at joint_2 (friction 0.0299 ± 0.0002 N m)``."""
    rows = numbers_worth_telling(finding)
    numbers = f" ({', '.join(map(value_in_words, rows[:2]))})" if rows else ""
    return words(finding.name) + numbers


def in_words(found: Sequence[Finding]) -> str:
    """Effects in one phrase: one by one, or where there are many, by kind and place."""
    kinds: dict[str, list[Finding]] = {}
    for finding in found:
        kinds.setdefault(finding.effect, []).append(finding)
    if len(found) <= MANY:
        return "; ".join(map(effect_in_words, found))
    return "; ".join(f"{kind.replace('_', ' ')} at {_places(own)}" for kind, own in kinds.items())


def _places(own: Sequence[Finding]) -> str:
    sites = [finding.site for finding in own]
    return ", ".join(sites[:-1]) + f" and {sites[-1]}" if len(sites) > 1 else sites[0]


def verdict(found: Sequence[Finding], rivals: Sequence[str], missing: bool, left: str, notes: Sequence[str]) -> str:
    """What was found.

    Args:
        rivals: names of what the recordings cannot tell from the answer. missing: whether anything is. left: a sentence
            about what has no name, or "". notes: sentences that belong to the verdict.
    """
    certain = [f for f in found if f.tier == CERTAIN]
    possible = [f for f in found if f.tier == POSSIBLE]
    small = [f for f in found if f.tier == SLIGHT]
    said = []
    if certain:
        said.append(f"Missing: {in_words(certain)}.")
    elif not missing:
        said.append("Nothing is missing that these recordings can show.")
    elif left or not possible:
        said.append("Something is missing that the catalogue cannot name.")
    if possible:
        said.append(f"May be missing: {_named(possible)}.")
    if small:
        said.append(f"Also, small: {_named(small)}.")
    if rivals:
        said.append(f"These recordings cannot tell the answer from {', or '.join(map(words, rivals[:MANY]))}.")
    return " ".join([*said, *([left] if left else []), *notes])


def _named(found: Sequence[Finding]) -> str:
    return ", ".join(words(finding.name) for finding in found[:6]) + (" and others" if len(found) > 6 else "")
