"""Experiments simulated by MuJoCo C: all that searches, for a design or for an estimate.

A step of MuJoCo C takes a fraction of MJX's, and nothing is compiled. Sensitivities are forward differences, good to
some 1e-5; what enters a result (the best fit, its intervals, information gathered) is differentiated exactly, by MJX.
Parameters come from `revise`, as in MJX, not from `edit`, as in the truth.
"""

import copy
import json
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from functools import partial, reduce
from typing import NamedTuple

from fimpact.paper.mjx.engine import mjx

import jax
import mujoco
import numpy as np
from mujoco.rollout import Rollout

from fimpact.paper.systems.base import System
from fimpact.support.mujoco_setup import hush

STEP = 1e-7  # relative; large against round-off, small against the bends of contact
AWAY = 1e-4  # m; a gap that no robot that differs by STEP closes
ENCODER_NOISE = 1e-3  # rad or m; what a contact-blind designer of a silent force sensor looks at instead
WIDTH = 64  # rows whose parameters or inputs are prepared together
CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


class Forecast(NamedTuple):
    """Of every row: whitened measurement (n, T * ny); smallest and first gap, m, negative in contact; positions in
    units of `ENCODER_NOISE` (n, T * nq). NaN where the simulation diverged."""

    measurement: np.ndarray
    closest: np.ndarray
    first: np.ndarray
    motion: np.ndarray


class Forecaster:
    """Simulations of one system; models are made once and rewritten for every robot."""

    def __init__(self, system: System):
        hush()
        self.system, self.template = system, system.compile_with_gaps(system.nominal)
        self._data, self._engine = mujoco.MjData(self.template), Rollout(nthread=0)
        self._models: list[mujoco.MjModel] = []
        self._prepare = _prepared(system)

    def forecast(self, rho: np.ndarray, design: np.ndarray, blind: bool = False) -> Forecast:
        """Simulate every row of `rho` (n, p), relative, with its row of `design` (n, d); `blind`: without contact."""
        robots, own = np.unique(rho, axis=0, return_inverse=True)
        models = self._robots(robots, blind)
        return self._run([models[i] for i in own.ravel()], design)

    def linearise(self, rho: np.ndarray, design: np.ndarray, blind: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Whitened measurement (n, T * ny) or, `blind`, motion, and its derivatives in rho, (n, T * ny, p).

        A row that keeps clear of the surface and reads nothing would read nothing of a robot that differs by `STEP`
        either: its derivatives are zero, and are not simulated.
        """
        p, found = rho.shape[1], self.forecast(rho, design, blind)
        seen = found.motion if blind else found.measurement
        silent = (found.closest > AWAY) & ~found.measurement.any(1)  # what diverged is NaN, which is not silent
        told = np.arange(len(rho)) if blind else np.flatnonzero(~silent)
        slopes = np.zeros((len(rho), p, seen.shape[1]))
        if len(told):
            moved = (rho[told, None] + STEP * np.eye(p)).reshape(-1, p)
            beside = self.forecast(moved, np.repeat(design[told], p, 0), blind)
            ahead = (beside.motion if blind else beside.measurement).reshape(len(told), p, -1)
            slopes[told] = (ahead - seen[told, None]) / STEP
        return seen, slopes.transpose(0, 2, 1)

    def _robots(self, rho: np.ndarray, blind: bool) -> list[mujoco.MjModel]:
        while len(self._models) < len(rho):
            self._models.append(copy.copy(self.template))
        values = self._prepare.robots(self.system.template, rho * self.system.nominal)
        for i, model in enumerate(self._models[: len(rho)]):
            for path, rows in values.items():
                _write(model, path, rows[i])
            model.opt.disableflags = self.template.opt.disableflags | (CONTACT if blind else 0)
            mujoco.mj_setConst(model, self._data)
        return self._models[: len(rho)]

    def _run(self, models: list[mujoco.MjModel], design: np.ndarray) -> Forecast:
        model, steps = self.template, self.system.steps
        each, own = np.unique(design, axis=0, return_inverse=True)  # many robots play the same design
        qpos, qvel, ctrl = (part[own.ravel()] for part in self._prepare.launches(each))
        start = np.zeros((len(models), mujoco.mj_stateSize(model, STATE)))
        start[:, 1 : 1 + model.nq + model.nv] = np.hstack([qpos, qvel])
        state, sensed = self._engine.rollout(models, self._data, start, ctrl if model.nu else None, nstep=steps)
        whole = state[:, -1, 0] > (steps - 0.5) * model.opt.timestep  # time starts anew where MuJoCo gave up
        measured = sensed[:, :, self.system.gauge(model)].reshape(len(models), -1) / self.system.sensor.noise
        gaps = sensed[:, :, model.nsensordata - model.npair :]
        places = np.concatenate([qpos[:, None], state[:, :-1, 1 : 1 + model.nq]], 1).reshape(len(models), -1)
        seen = measured, gaps.min((1, 2)), gaps[:, 0].min(1), places / ENCODER_NOISE
        return Forecast(*(np.where(whole.reshape(-1, *[1] * (part.ndim - 1)), part, np.nan) for part in seen))


class _Prepared(NamedTuple):
    """What JAX computes of a system: model fields of robots theta (n, p), and launches of designs (n, d)."""

    robots: Callable
    launches: Callable


_PREPARED: dict[str, _Prepared] = {}
_SHARED: dict[str, Forecaster] = {}


def forecaster(system: System) -> Forecaster:
    """The forecaster of `system`, made once per process."""
    key = f"{system.name} {json.dumps(system.settings)}"
    if key not in _SHARED:
        _SHARED[key] = Forecaster(system)
    return _SHARED[key]


def _prepared(system: System) -> _Prepared:
    """Shared by systems that differ only in where their surface is; they are not told it, as in `programs`."""
    blind = {name: value for name, value in system.settings.items() if name != "surface"}
    key, blind_system = f"{system.name} {json.dumps(blind)}", replace(system, settings=blind)
    if key not in _PREPARED:
        paths = _changed(system.template, system.revise(system.template, system.nominal, blind))

        def revised(model: mjx.Model, theta: jax.Array) -> list[jax.Array]:
            after = system.revise(model, theta, blind)
            return [reduce(getattr, path, after) for path in paths]

        robots = _chunked(jax.jit(jax.vmap(revised, (None, 0))))
        launches = _chunked(jax.jit(jax.vmap(partial(system.launch, blind_system))))
        _PREPARED[key] = _Prepared(lambda *args: dict(zip(paths, robots(*args), strict=True)), launches)
    return _PREPARED[key]


def _changed(old, new, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Paths of the model's fields that `revise` writes."""
    if old is new:
        return []
    if is_dataclass(old):
        parts = ((getattr(old, f.name), getattr(new, f.name), (*path, f.name)) for f in fields(old))
        return [found for part in parts for found in _changed(*part)]
    return [path]


def _write(model: mujoco.MjModel, path: tuple[str, ...], value: np.ndarray) -> None:
    holder = reduce(getattr, path[:-1], model)
    if isinstance(getattr(holder, path[-1]), np.ndarray):
        getattr(holder, path[-1])[...] = value
    else:
        setattr(holder, path[-1], value.item())


def _chunked(function: Callable) -> Callable:
    """`function` on any number of rows, the last argument, `WIDTH` at a time: every other shape would compile again."""

    def run(*args) -> list[np.ndarray]:
        rows = args[-1]
        fill = np.arange(-(-len(rows) // WIDTH) * WIDTH) % len(rows)
        parts = [function(*args[:-1], rows[fill[i : i + WIDTH]]) for i in range(0, len(fill), WIDTH)]
        return [np.concatenate(leaves)[: len(rows)] for leaves in zip(*parts, strict=True)]

    return run
