"""Which cases a benchmark has, in an order that tells nothing, and which of them the slow comparators run on."""

from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from fimpact.concealed.rigs import RIGS


@dataclass(frozen=True)
class Case:
    """One case: its name, and what `draw_case` is asked for; system: "" is any rig."""

    name: str
    kind: str
    index: int
    system: str


def case_names(settings: dict[str, Any]) -> list[str]:
    """Names of all cases; they say nothing about what is in them."""
    count = sum(settings["cases"].values())
    return [f"{number:0{len(str(count))}d}" for number in range(1, count + 1)]


def plan(settings: dict[str, Any]) -> list[Case]:
    """All cases in the order of their names, which is shuffled by the seed.

    Args:
        settings: the table ``concealed`` of the configuration.
    """
    drawn = [(kind, index) for kind, count in settings["cases"].items() for index in range(count)]
    order = np.random.default_rng([settings["seed"], 0]).permutation(len(drawn))
    every = set(settings["rigs"]) == set(RIGS)
    rigs = [""] if every else settings["rigs"]
    return [
        Case(name, kind, index // len(rigs), rigs[index % len(rigs)])
        for name, (kind, index) in zip(case_names(settings), (drawn[i] for i in order), strict=True)
    ]


def compared(settings: dict[str, Any], key: str = "compared") -> list[str]:
    """Names of the random share of the cases on which slow comparators run; chosen before anything is planted.

    Args:
        key: the share's, ``compared``, ``refitted`` or ``played``; the smaller share is part of the larger.
    """
    every = case_names(settings)
    count = ceil(settings[key] * len(every) - 1e-9)
    return sorted(np.random.default_rng([settings["seed"], 1]).permutation(every)[:count].tolist())
