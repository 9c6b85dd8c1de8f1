"""Choosing an effect's size so that an oracle sees it with a given non-centrality."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fimpact.benchmark.drawing.detectability import (
    Visibility,
    White,
    absorbed_by,
    coloured,
    noise_inflation,
    noise_of,
    visibility_of,
    whitener,
)
from fimpact.benchmark.drawing.motions import Motion
from fimpact.benchmark.drawing.tangents import Tangents, Windows, cut, gather, models, predict, tangents
from fimpact.benchmark.planting.ground_truth import new_world, play
from fimpact.benchmark.planting.out_of_catalogue import plant
from fimpact.benchmark.planting.plant import Plant, Values
from fimpact.benchmark.rigs.rig import Rig

MOVES = 6  # how often the unknowns are moved to imitate an effect
STILL = 0.01  # relative change of its non-centrality at which they are not moved further
LEAST = -0.8  # relative error beyond which no unknown is taken: a mass stays positive
CLOSE, NEAR = 0.08, 0.2  # in log lambda: of the search, and of what is accepted after its tangents are renewed
RENEWALS, SEARCHES = 5, 7  # of the tangents, and sizes tried with each
NOTHING = 1e-4  # of the size at which a search begins: what is seen of so little is not the effect


class Unfit(Exception):
    """This draw cannot be used: the effect does not act, or would need an absurd size."""


@dataclass(frozen=True)
class Stage:
    """A robot and its training motions before anything is planted. noise: (W, n ny, m) whitened disturbance, of size
    `disturbance` and memory `correlation`, s."""

    rig: Rig
    motion: Motion
    errors: np.ndarray
    start: np.ndarray
    tangent: Tangents
    noise: np.ndarray
    disturbance: float
    correlation: float

    @cached_property
    def white(self) -> White:
        """Measurements, (W, n ny, k), in units in which sensor noise and disturbance are white."""
        return whitener(self.noise)


@dataclass(frozen=True)
class Trace:
    """A planted effect as its windows show it: size, values, whitened trace (W, n ny, 1) and renewed tangents."""

    size: float
    values: Values
    change: np.ndarray
    tangent: Tangents


def set_stage(rig: Rig, motion: Motion, errors, start, correlation: float, raised: float) -> Stage:
    """Tangents of the unplanted robot, and a disturbance that raises the residual's variance by `raised`."""
    tangent = _unplanted(rig, motion, errors, start)
    assert tangent.push is not None  # `_unplanted` asks for it
    sd = float(np.sqrt(raised / noise_inflation(rig, tangent, coloured(rig, tangent.push, correlation))))
    noise = noise_of(rig, tangent.push, sd, correlation)
    return Stage(rig, motion, errors, start, tangent, noise, sd, correlation)


def with_all_runs(stage: Stage) -> Stage:
    """The same robot with all of its motions for training, those that are held out as well."""
    motion = replace(stage.motion, held_out=np.zeros_like(stage.motion.held_out))
    tangent = _unplanted(stage.rig, motion, stage.errors, stage.start)
    assert tangent.push is not None  # `_unplanted` asks for it
    noise = noise_of(stage.rig, tangent.push, stage.disturbance, stage.correlation)
    return replace(stage, motion=motion, tangent=tangent, noise=noise)


def _unplanted(rig: Rig, motion: Motion, errors, start) -> Tangents:
    runs = np.flatnonzero(~motion.held_out)
    states = play(new_world(rig, errors, fine=False), start[runs], motion.ctrl[runs]).states
    return tangents(rig, errors, cut(rig, motion, states, runs), pushed=True)


def planted_windows(stage: Stage, name: str, site: str, values: Values) -> tuple[Windows, np.ndarray, np.ndarray]:
    """Windows of the planted robot, what they would show without the effect, (W, n ny), and what it changes in them,
    (W, n ny, 1)."""
    rig, runs = stage.rig, np.flatnonzero(~stage.motion.held_out)
    world = new_world(rig, stage.errors, fine=False)
    plant(world, name, site, values)
    played = play(world, stage.start[runs], stage.motion.ctrl[runs])
    windows = cut(rig, stage.motion, played.states, runs)
    shown = (gather(windows, played.samples) / rig.sd).reshape(len(windows.row), -1)
    plain = predict(rig, models(rig, stage.errors), windows.start, windows.ctrl)
    change = shown - plain
    if not np.isfinite(change).all() or np.abs(played.states).max() > 1e3:
        raise Unfit(f"{name} at {site} makes the simulation diverge")
    return windows, plain, change[:, :, None]


def trace(stage: Stage, name: str, site: str, size: float, values: Values) -> Trace:
    """The effect at one size, with tangents about its own motion."""
    windows, plain, change = planted_windows(stage, name, site, values)
    tangent = tangents(stage.rig, stage.errors, windows, pushed=False)
    return Trace(size, values, _imitated(stage, windows, plain, change, tangent), tangent)


def _imitated(stage: Stage, windows, plain, change, tangent: Tangents):
    """`change` as it shows beside the best imitation by unknowns and starts: what is nonlinear in a large change of
    theirs must not pass for what they cannot imitate."""
    rig, size, start = stage.rig, np.inf, np.zeros_like(windows.start)
    shown = change[:, :, 0] + plain
    for _ in range(MOVES):
        unknown, wanted = absorbed_by(rig, tangent, stage.white, change)
        unknown = np.maximum(unknown, LEAST - stage.errors)
        model, moves = models(rig, stage.errors + unknown), (wanted, start)
        left = [shown - predict(rig, model, windows.start + move, windows.ctrl) for move in moves]
        # Where the mechanism strikes, the tangent's start may be worse than the last one.
        first = (np.nan_to_num((left[0] ** 2).sum(1), nan=np.inf) <= (left[1] ** 2).sum(1))[:, None]
        start, left = np.where(first, wanted, start), np.where(first, left[0], left[1])
        if not np.isfinite(left).all():
            break
        linear = tangent.unknown @ unknown + np.einsum("wmx,wx->wm", tangent.start, start)
        change, last = (left + linear)[:, :, None], size
        size = float(visibility_of(rig, tangent, stage.white, change).size[0])
        if abs(size - last) < STILL * last:
            break
    return change


def visibility(stage: Stage, *traces: Trace) -> Visibility:
    """What an oracle sees of each of some traces, with the tangents of the first."""
    return visibility_of(stage.rig, traces[0].tangent, stage.white, np.concatenate([t.change for t in traces], axis=2))


def concealment(stage: Stage, found: Trace) -> tuple[float, float]:
    """kappa against the sensors' noise, and kappa of the unknowns alone with the starts projected off first."""
    kappa, unknown = visibility_of(stage.rig, found.tangent, whitener(0 * stage.noise), found.change).concealment
    return float(kappa[0]), float(unknown[0])


def fit_size(stage: Stage, name: str, site: str, kind: Plant, shape: Values, sign: float, target: float) -> Trace:
    """The effect at the size at which its non-centrality is `target`. Raises Unfit."""
    tangent, size = stage.tangent, kind.span(stage.rig)[0]
    for _ in range(RENEWALS):
        size = _search(stage, name, site, kind, shape, sign, target, tangent, size)
        found = trace(stage, name, site, sign * size, kind.values(sign * size, **shape))
        if abs(np.log(max(visibility(stage, found).size[0], 1e-9) / target)) < NEAR:
            return found
        tangent = found.tangent
    raise Unfit(f"no size of {name} at {site} settles at lambda {target:.3g}")


def estimate_size(stage: Stage, name: str, site: str, kind: Plant, shape: Values, sign: float, target: float) -> Trace:
    """As `fit_size`, but with the tangents of the unplanted robot: quick, and good enough to see what is hopeless."""
    size = _search(stage, name, site, kind, shape, sign, target, stage.tangent, kind.span(stage.rig)[0])
    values = kind.values(sign * size, **shape)
    windows, plain, change = planted_windows(stage, name, site, values)
    return Trace(size, values, _imitated(stage, windows, plain, change, stage.tangent), stage.tangent)


def _search(stage, name, site, kind, shape, sign, target, tangent, size):
    """Secant steps on log lambda against log size, with fixed tangents."""
    slope, last, (begin, most) = 2.0, None, kind.span(stage.rig)
    for _ in range(SEARCHES):
        windows, plain, change = planted_windows(stage, name, site, kind.values(sign * size, **shape))
        change = _imitated(stage, windows, plain, change, tangent)
        miss = np.log(max(visibility_of(stage.rig, tangent, stage.white, change).size[0], 1e-9) / target)
        if abs(miss) < CLOSE:
            return size
        if size < NOTHING * begin and miss > 0:
            raise Unfit(f"{name} at {site} shows more than lambda {target:.3g} at any size")
        if size >= most and miss < 0:
            raise Unfit(f"{name} at {site} would have to be larger than {most:g}")
        if last and last[0] != np.log(size):
            slope = np.clip((miss - last[1]) / (np.log(size) - last[0]), 0.7, 4.0)
        last = np.log(size), miss
        size = min(size * np.exp(np.clip(-miss / slope, -4.0, 4.0)), most)
    return size
