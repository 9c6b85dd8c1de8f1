"""Whether any experiment would split a pair of twins: one that none can split is no test of who designs it."""

from dataclasses import replace

import numpy as np

from fimpact.benchmark.drawing.detectability import noise_of, residual_after, whitener
from fimpact.benchmark.drawing.effect_size import Stage, Trace, planted_windows
from fimpact.benchmark.drawing.motions import Motion
from fimpact.benchmark.drawing.tangents import Tangents, tangents

TRIED = 24  # random experiments
KNOTS = 8  # per motor, between which commands are linear; every other experiment has a square wave on top
SPLIT = 11.0  # non-centrality for 80 % power at 1 %
MOST = 9.0  # that one window may count for: wild motion magnifies a difference, and what hides it


def best_split(stage: Stage, places: list[tuple[str, str]], traces: list[Trace], rng: np.random.Generator) -> float:
    """What is left of lambda of the first of two effects, the second known, after the best of some random experiments:
    each as long as a training run, within the commands and starts of those, and judged together with them.

    All is linear in unknowns, starts and the size of the second effect, whose ratios and shapes stay: where it contains
    the first, what it could do beside is not asked.

    Args:
        places: (effect, site) of both. traces: of both, as the training runs show them.

    Raises:
        Unfit: in one of the experiments an effect makes the simulation diverge.
    """
    motion = _experiments(stage, rng)
    tried = replace(stage, motion=motion, start=motion.start)
    shown = [planted_windows(tried, *at, own.values) for at, own in zip(places, traces, strict=True)]
    windows, tangent = shown[0][0], tangents(stage.rig, stage.errors, shown[0][0], pushed=True)
    assert tangent.push is not None  # of `pushed` tangents
    noise = noise_of(stage.rig, tangent.push, stage.disturbance, stage.correlation)
    recorded = stage.noise, np.concatenate([own.change for own in traces], 2)
    further = noise, np.concatenate([change for *_, change in shown], 2)
    found = []
    for run in range(TRIED):
        at = windows.row == run
        both = _joined(traces[0].tangent, tangent, at)
        noise, shows = (np.concatenate([old, new[at]]) for old, new in zip(recorded, further, strict=True))
        found.append(float(np.minimum(residual_after(stage.rig, both, whitener(noise), shows), MOST).sum()))
    return max(found)


def _experiments(stage: Stage, rng: np.random.Generator) -> Motion:
    """`TRIED` random ones, half of them with smaller commands, each by a factor of its own."""
    train = ~stage.motion.held_out
    ctrl, start = stage.motion.ctrl[train], stage.motion.start[train]
    low, high, (samples, nu) = ctrl.min((0, 1)), ctrl.max((0, 1)), ctrl.shape[1:]
    calm = np.where(np.arange(TRIED) % 4 < 2, 1.0, rng.uniform(0, 1, TRIED))
    knots = calm[:, None, None] * rng.uniform(low, high, (TRIED, KNOTS, nu))
    time = np.linspace(0, KNOTS - 1, samples)
    lines = [np.interp(time, np.arange(KNOTS), one) for own in knots for one in own.T]
    waves = _waves(rng, samples)[:, None] * (rng.uniform(0, 1, (TRIED, nu)) * (high - low))[:, :, None]
    out = np.reshape(lines, (TRIED, nu, samples)) + waves  # of what is thrown: nothing
    began = rng.uniform(start.min(0), start.max(0), (TRIED, start.shape[1]))
    return Motion(began, np.clip(out.transpose(0, 2, 1), low, high), np.zeros(TRIED, bool))


def _waves(rng: np.random.Generator, samples: int) -> np.ndarray:
    """A square wave between -1/2 and 1/2 for every other experiment, nothing for the others, (TRIED, samples); periods
    of four samples at least."""
    cycles = np.exp(rng.uniform(0, np.log(samples / 4), TRIED))
    phase = np.arange(samples) * cycles[:, None] / samples
    return np.where(phase % 1 < 0.5, 0.5, -0.5) * (np.arange(TRIED) % 2)[:, None]


def _joined(old: Tangents, new: Tangents, at: np.ndarray) -> Tangents:
    """Tangents of recorded windows and of those of one experiment, each run with a clock of its own."""
    clock = np.zeros((len(old.clock) + at.sum(), old.clock.shape[1], old.clock.shape[2] + 1))
    clock[: len(old.clock), :, :-1], clock[len(old.clock) :, :, -1:] = old.clock, new.clock[at].sum(2, keepdims=True)
    parts = ((old.opens, new.opens), (old.start, new.start), (old.unknown, new.unknown))
    opens, start, unknown = (np.concatenate([one, other[at]]) for one, other in parts)
    return Tangents(opens, start, unknown, clock)
