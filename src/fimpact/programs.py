"""The compiled programs of a system, fed in batches of one fixed width.

A fixed width matters twice: every other shape would compile again, and the last bits of a vmapped result
depend on the width, which contact can amplify. The MJX model is an argument, so moving the surface,
relaxing contact or removing it compiles nothing.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import fimpact.engine  # noqa: F401

import jax
import jax.numpy as jnp
import numpy as np

from fimpact.information import CRITERIA, Linearisation, fisher, linearise
from fimpact.rollout import rollout
from fimpact.systems.base import System
from fimpact.traced import traced

PREDICT_WIDTH, LINEARISE_WIDTH = 32, 8  # beyond these a row gets hardly cheaper


class Prediction(NamedTuple):
    """Whitened measurement (T * ny,); smallest and first contact distance, m, negative in contact."""

    measurement: jax.Array
    closest: jax.Array
    first: jax.Array


class Programs(NamedTuple):
    """Batched programs; every one takes (model, rho, design), with rho (n, p) and design (n, d).

    predict: `Prediction` with a leading axis n.
    linearise: `Linearisation` with a leading axis n.
    climb: of (criterion, model, rho (p,), design (d,), known (p, p), blind) -> value and gradient (d,).
    """

    predict: Callable
    linearise: Callable
    climb: Callable


_SHARED: dict[str, Programs] = {}


def programs(system: System) -> Programs:
    """The programs of `system`; systems that differ only in where their surface is share them, and are not told it:
    `revise` and `launch` may not ask for what is no argument of a program."""
    blind = {name: value for name, value in system.settings.items() if name != "surface"}
    key = f"{system.name} {json.dumps(blind)}"  # in their order, which is that of the parameters
    if key not in _SHARED:
        _SHARED[key] = _build(replace(system, settings=blind), key)
    return _SHARED[key]


def _build(system: System, key: str) -> Programs:
    def predict(model, rho, design):
        run = rollout(system, model, rho * system.nominal, design)
        whitened = run.measurement.ravel() / system.sensor.noise
        return Prediction(whitened, run.distance.min(), run.distance[0].min())

    climbers = {
        name: traced(partial(_climb, system, name), f"{key} climb {name}", lambda *pair: pair) for name in CRITERIA
    }
    return Programs(
        _in_batches(predict, PREDICT_WIDTH, f"{key} predict", Prediction),
        _in_batches(partial(linearise, system), LINEARISE_WIDTH, f"{key} linearise", Linearisation),
        lambda criterion, *args: climbers[criterion](*args),
    )


def _climb(system: System, criterion: str, model, rho, design, known, blind):
    def value(design):
        point = linearise(system, model, rho, design)
        gained = jnp.where(blind, fisher(point.motion), fisher(point.sensitivity))
        result = CRITERIA[criterion](known + gained)
        return result, result

    # Forward over forward: MJX's contact solver has no reverse mode (mujoco#2259).
    gradient, result = jax.jacfwd(value, has_aux=True)(design)
    return result, gradient


def _in_batches(function: Callable, width: int, key: str, result: type) -> Callable:
    """`function` on any number of rows, in slices of `width`; the last one is filled up with repeats."""
    program = traced(jax.vmap(function, (None, 0, 0)), f"{key} {width}", result)

    def run(model, rho: np.ndarray, design: np.ndarray):
        rho, design = np.atleast_2d(rho), np.atleast_2d(design)
        count = max(len(rho), len(design))
        fill = np.arange(-(-count // width) * width) % count
        rho, design = (np.broadcast_to(a, (count, a.shape[1]))[fill] for a in (rho, design))
        slices = [slice(i, i + width) for i in range(0, len(fill), width)]
        parts = [program(model, rho[s], design[s]) for s in slices]
        return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *parts)

    return run


def compile_programs(system: System, criterion: str) -> None:
    """Trace and compile all programs once, so that the jobs that follow find them in the cache."""
    rho, design = np.ones(len(system.nominal)), np.mean(system.inputs.bounds, 0)
    ready = programs(system)
    ready.predict(system.template, rho, design)
    ready.linearise(system.template, rho, design)
    ready.climb(criterion, system.template, rho, design, np.eye(len(rho)), False)
