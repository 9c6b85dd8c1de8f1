"""The compiled program of a system, fed in batches of one fixed width.

A fixed width matters twice: every other shape would compile again, and the last bits of a vmapped result
depend on the width, which contact can amplify. The MJX model is an argument, so moving the surface compiles nothing.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import fimpact.paper.mjx.engine  # noqa: F401

import jax
import numpy as np

from fimpact.paper.information.fisher import Linearisation, linearise
from fimpact.paper.information.traced import traced
from fimpact.paper.systems.base import System

WIDTH = 8  # beyond it a row gets hardly cheaper


class Programs(NamedTuple):
    """`linearise` takes (model, rho, design), with rho (n, p) and design (n, d), and gives a `Linearisation` with a
    leading axis n."""

    linearise: Callable


_SHARED: dict[str, Programs] = {}


def programs(system: System) -> Programs:
    """The program of `system`; systems that differ only in where their surface is share it, and are not told it:
    `revise` and `launch` may not ask for what is no argument of a program."""
    blind = {name: value for name, value in system.settings.items() if name != "surface"}
    key = f"{system.name} {json.dumps(blind)}"  # in their order, which is that of the parameters
    if key not in _SHARED:
        told = replace(system, settings=blind)
        _SHARED[key] = Programs(_in_batches(partial(linearise, told), f"{key} linearise", Linearisation))
    return _SHARED[key]


def _in_batches(function: Callable, key: str, result: type) -> Callable:
    """`function` on any number of rows, in slices of `WIDTH`; the last one is filled up with repeats."""
    program = traced(jax.vmap(function, (None, 0, 0)), f"{key} {WIDTH}", result)

    def run(model, rho: np.ndarray, design: np.ndarray):
        rho, design = np.atleast_2d(rho), np.atleast_2d(design)
        count = max(len(rho), len(design))
        fill = np.arange(-(-count // WIDTH) * WIDTH) % count
        rho, design = (np.broadcast_to(a, (count, a.shape[1]))[fill] for a in (rho, design))
        slices = [slice(i, i + WIDTH) for i in range(0, len(fill), WIDTH)]
        parts = [program(model, rho[s], design[s]) for s in slices]
        return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *parts)

    return run


def compile_programs(system: System) -> None:
    """Trace and compile once, so that the jobs that follow find the program in the cache."""
    programs(system).linearise(system.template, np.ones(len(system.nominal)), np.mean(system.inputs.bounds, 0))
