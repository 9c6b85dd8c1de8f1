"""Which cases a benchmark has, in an order that tells nothing, and which of them the slow comparators run on."""

from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from fimpact.benchmark.rigs.registry import RIGS


@dataclass(frozen=True)
class Case:
    """One case: its name, and what `draw_case` is asked for; system: "" is any rig."""

    name: str
    kind: str
    index: int
    system: str


def case_names(settings: dict[str, Any]) -> list[str]:
    """Names of the cases, the first `share` of all; they say nothing about what is in them."""
    every = _every_name(settings)
    return every[: ceil(settings.get("share", 1.0) * len(every) - 1e-9)]


def _every_name(settings: dict[str, Any]) -> list[str]:
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
    found = [
        Case(name, kind, index // len(rigs), rigs[index % len(rigs)])
        for name, (kind, index) in zip(_every_name(settings), (drawn[i] for i in order), strict=True)
    ]
    return found[: len(case_names(settings))]


def compared(settings: dict[str, Any], key: str = "compared") -> list[str]:
    """Names of the random share of the cases on which slow comparators run; chosen before anything is planted.

    Args:
        key: the share's, ``compared``, ``refitted`` or ``played``; the smaller share is part of the larger.
    """
    every = _every_name(settings)
    count = ceil(settings[key] * len(every) - 1e-9)
    chosen = np.random.default_rng([settings["seed"], 1]).permutation(every)[:count].tolist()
    return sorted(set(chosen) & set(case_names(settings)))


def entered(settings: dict[str, Any]) -> list[str]:
    """Names of the cases that other tools enter and an oracle fits: those that are compared, and every crowd."""
    crowds = {case.name for case in plan(settings) if case.kind == "crowd"}
    return sorted(crowds.union(compared(settings)))
