"""Noise levels of a smoother: of the missing force by joint and mode, and of the readings.

Where friction holds a joint, all that it holds is missing, and must not hide what little is missing of the motion: what
rests there has a level of its own.

They follow the gradient of the marginal likelihood, which the adjoint of the filter gives in one pass (Koopman,
Biometrika 80(1), 1993; MacKay, Neural Computation 4(3), 1992).
"""

from dataclasses import dataclass, replace

import numpy as np

from fimpact.deciding import CONFIDENCE, FALL, SWITCH, TIED
from fimpact.effects.touching import can_touch
from fimpact.smoothing.dynamics.dry_friction import Rubbing
from fimpact.smoothing.dynamics.laws import expected_sign, middle, speed_doubt
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States

LEAST = 1e-4  # of its first size: a missing force that is smaller is none
FLIGHT, STANCE, CHANGE = 0, 1, 2  # contact modes


@dataclass(frozen=True)
class Levels:
    """Noise: sd of the missing force by contact mode, of what moves and then of what rests, (2 modes, nv), least (nv,)
    it may be, contact mode of each sample, (N,), and whether friction may hold it, (N, nv); sd of the
    readings, (ny,), and how much louder they are taken while a fit is annealed, (ny,). pull: derivative of the marginal
    log likelihood by the logarithm of each force's level, (2 modes, nv), as they were last moved."""

    force: np.ndarray
    least: np.ndarray
    mode: np.ndarray
    rests: np.ndarray
    reading: np.ndarray
    louder: np.ndarray
    pull: np.ndarray

    @property
    def forces(self) -> np.ndarray:
        """sd of the missing force in each sample, (N, nv)."""
        return np.take_along_axis(self.force, self._row, 0)

    @property
    def rows(self) -> list[np.ndarray]:
        """Which samples and coordinates are of each row of `force`, masks (N, nv)."""
        return [self._row == i for i in range(len(self.force))]

    def summed(self, squared: np.ndarray) -> np.ndarray:
        """Sum of `squared`, (N, nv), over the samples of each contact mode, (modes, nv)."""
        modes = np.arange(len(self.force) // 2)[:, None] == self.mode
        return modes.astype(float) @ squared

    @property
    def _row(self) -> np.ndarray:
        return self.mode[:, None] + len(self.force) // 2 * self.rests


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
    ratio = np.array([_ratio((asked * own).sum(0), (force * own).sum(0)) for own in levels.rows])
    step = np.exp(pace(np.log(np.concatenate([ratio.ravel(), np.where(levels.louder > 1, 1.0, loud)])) / 2))
    sd = np.clip(levels.force * step[: ratio.size].reshape(ratio.shape), begun.force / FALL, begun.force * FALL)
    reading = np.clip(levels.reading * step[ratio.size :], *track.believed(noise))
    more = np.array([((asked - force) * own).sum(0) for own in levels.rows])
    return replace(levels, force=np.maximum(sd, levels.least), reading=reading, pull=levels.force**2 * more)


def moved_by(levels: Levels, begun: Levels) -> float:
    """By how much levels have moved, in logarithms, of those whose move the likelihood feels: a force that is nothing
    goes on shrinking for ever."""
    weighty = np.abs(levels.pull) > TIED
    return float(np.abs(np.log(levels.force / begun.force))[weighty].max(initial=0.0))


def _ratio(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    return np.where(expected > 0, np.maximum(found, 1e-300) / np.maximum(expected, 1e-300), 1.0)


def first_levels(track: Track, states: States, tau: np.ndarray, noise: np.ndarray) -> Levels:
    """Levels as the force that a first trajectory lacks, (N, nv), has them."""
    sd = np.sqrt(np.mean(tau**2, 0)) + 1e-12
    rows = np.tile(sd, (2 * (3 if can_touch(track.model) else 1), 1))
    still = np.zeros(track.count, int), np.zeros(tau.shape, bool)
    levels = Levels(rows, LEAST * sd, *still, noise.copy(), np.ones(len(noise)), 0 * rows)
    levels = in_modes(track, states, levels)
    own = [np.where(r.any(0), np.sqrt((tau**2 * r).sum(0) / np.maximum(r.sum(0), 1)) + 1e-12, sd) for r in levels.rows]
    return replace(levels, force=np.maximum(own, levels.least))


def resting(track: Track, states: States, doubt: np.ndarray, rubbing: Rubbing, levels: Levels) -> Levels:
    """What rests anew: where there is dry friction, and a speed, known to the sd `doubt`, (N, nv), is not told from
    zero over a sample. One that reverses is told from it at both ends."""
    over = expected_sign(middle(track, states)[1], speed_doubt(track, states, doubt))
    ends = np.abs(expected_sign(states.qvel, doubt)) < CONFIDENCE
    ends |= ends[np.arange(track.count) + ~track.last]
    return replace(levels, rests=(np.abs(over) < CONFIDENCE) & ends & rubbing.force.any(0))


def in_modes(track: Track, states: States, levels: Levels) -> Levels:
    """Contact modes anew: flight, stance, and the few samples about a change of the two."""
    if not can_touch(track.model):
        return levels
    now = track.touching(states)
    mode = np.where(now, STANCE, FLIGHT)
    for rows in track.slices():
        for at in rows.start + 1 + np.flatnonzero(now[rows][1:] != now[rows][:-1]):
            mode[max(at - SWITCH, rows.start) : min(at + SWITCH, rows.stop)] = CHANGE
    return replace(levels, mode=mode)
