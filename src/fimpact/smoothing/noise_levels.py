"""Noise levels of a smoother: of the missing force by joint and contact mode, and of the readings.

They follow the gradient of the marginal likelihood, which the adjoint of the filter gives in one pass (Koopman,
Biometrika 80(1), 1993; MacKay, Neural Computation 4(3), 1992).
"""

from dataclasses import dataclass, replace

import numpy as np

from fimpact.deciding import FALL, SWITCH, TIED
from fimpact.effects.touching import can_touch
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States

LEAST = 1e-4  # of its first size: a missing force that is smaller is none
FLIGHT, STANCE, CHANGE = 0, 1, 2  # contact modes


@dataclass(frozen=True)
class Levels:
    """Noise: sd of the missing force by mode, (modes, nv), least (nv,) it may be, and mode of each sample, (N,); sd of
    the readings, (ny,), and how much louder they are taken while a fit is annealed, (ny,). pull: derivative of the
    marginal log likelihood by the logarithm of each force's level, (modes, nv), as they were last moved."""

    force: np.ndarray
    least: np.ndarray
    mode: np.ndarray
    reading: np.ndarray
    louder: np.ndarray
    pull: np.ndarray

    @property
    def forces(self) -> np.ndarray:
        """sd of the missing force in each sample, (N, nv)."""
        return self.force[self.mode]


class Pace:
    """How far levels are moved along the gradient: further as long as it points the same way."""

    def __init__(self):
        self.last, self.reach = None, None

    def __call__(self, gradient: np.ndarray) -> np.ndarray:
        """A step of the logarithms of the levels."""
        if self.last is None or self.last.shape != gradient.shape:
            self.reach = np.ones_like(gradient)
        else:
            same = np.sign(self.last) == np.sign(gradient)
            self.reach = np.where(same, np.minimum(2 * self.reach, 8.0), 1.0)
        self.last = gradient
        return np.clip(self.reach * gradient, -np.log(FALL), np.log(FALL))


def nearer(levels: Levels, begun: Levels, adjoint, errors, expected, noise, pace: Pace, track: Track) -> Levels:
    """Levels nearer to the greatest marginal likelihood.

    Args:
        begun: those from which they may go a factor of `FALL`. adjoint: of the missing force, (N, nv); errors: of the
            readings, (N, ny). expected: variances of both. noise: what the samples show of the readings', (ny,).
    """
    asked, (force, read) = adjoint**2, expected
    known = np.isfinite(track.measured)
    loud = _ratio((errors**2 * known).sum(0), (read * known).sum(0))
    rows = [levels.mode == mode for mode in range(len(levels.force))]
    ratio = np.array([_ratio(asked[r].sum(0), force[r].sum(0)) for r in rows])
    step = np.exp(pace(np.log(np.concatenate([ratio.ravel(), np.where(levels.louder > 1, 1.0, loud)])) / 2))
    sd = np.clip(levels.force * step[: ratio.size].reshape(ratio.shape), begun.force / FALL, begun.force * FALL)
    reading = np.clip(levels.reading * step[ratio.size :], *track.believed(noise))
    more = np.array([asked[r].sum(0) - force[r].sum(0) for r in rows])
    return replace(levels, force=np.maximum(sd, levels.least), reading=reading, pull=levels.force**2 * more)


def moved_by(levels: Levels, begun: Levels) -> float:
    """By how much levels have moved, in logarithms, of those whose move the likelihood feels: a force that is nothing
    goes on shrinking for ever."""
    weighty = np.abs(levels.pull) > TIED
    return float(np.abs(np.log(levels.force / begun.force))[weighty].max(initial=0.0))


def _ratio(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    return np.where(expected > 0, np.maximum(found, 1e-300) / np.maximum(expected, 1e-300), 1.0)


def first_levels(track: Track, states: States, tau: np.ndarray, noise: np.ndarray) -> Levels:
    sd = np.sqrt(np.mean(tau**2, 0)) + 1e-12
    levels = Levels(sd[None], LEAST * sd, np.zeros(track.count, int), noise.copy(), np.ones(len(noise)), 0 * sd[None])
    return in_modes(track, states, tau, levels)


def in_modes(track: Track, states: States, tau: np.ndarray, levels: Levels) -> Levels:
    """Contact modes anew: flight, stance, and the few samples about a change of the two."""
    if not can_touch(track.model):
        return levels
    now = track.touching(states)
    mode = np.where(now, STANCE, FLIGHT)
    for rows in track.slices():
        for at in rows.start + 1 + np.flatnonzero(now[rows][1:] != now[rows][:-1]):
            mode[max(at - SWITCH, rows.start) : min(at + SWITCH, rows.stop)] = CHANGE
    force, pull = levels.force, levels.pull
    if len(force) == 1:
        own = [np.sqrt(np.mean(tau[mode == m] ** 2, 0)) + 1e-12 if (mode == m).any() else force[0] for m in range(3)]
        force, pull = np.array(own), np.repeat(pull, 3, 0)
    return replace(levels, mode=mode, force=np.maximum(force, levels.least), pull=pull)
