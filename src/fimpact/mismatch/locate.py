"""Locate: where the unexplained part sits: in the mechanism, in time, in contact mode and in state.

An arbitrary force is allowed in one degree of freedom, then an arbitrary error in one sensor, and the parameters are
fitted along. What that explains, in excess of what the same freedom would explain of noise, is that place's share. No
catalogue is used: a place can be found where nothing can be named.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fimpact.mismatch.fit import Fit
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.pulses import BINS, Pulses

RIDGE = 1e-6  # of the largest singular value; below it a force changes nothing
SLOW = 0.25  # of the root mean square speed: below, a joint counts as reversing


@dataclass(frozen=True)
class Place:
    """A degree of freedom or a channel: what freeing it explains of the residual, the degrees of freedom that took,
    and the share of all that is explainable (sums to more than 1: places imitate each other)."""

    name: str
    kind: str
    explained: float
    freedom: float
    share: float


@dataclass(frozen=True)
class Location:
    """Places in falling order; residual force (w, BINS, nv) with standard deviations at the middle of each bin:
    time (w, BINS) s, qpos and qvel there; mode of each bin, (w, BINS); share of each mode and state in words."""

    places: list[Place]
    force: np.ndarray
    deviation: np.ndarray
    time: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    mode: np.ndarray
    modes: dict[str, float]
    states: dict[str, float]
    dofs: tuple[str, ...]
    sentence: str


def locate(problem: Problem, fitted: Fit, pulses: Pulses) -> Location:
    """Where the residual of `fitted` sits."""
    columns, dofs = pulses.columns, pulses.dofs
    left = fitted.linear.off(fitted.point.residual)
    # What parameters alone would take is no place's: a fit that weighs disturbances leaves some of it to ordinary
    # squares.
    total = float((left**2).sum()) - _refitted(left, fitted.linear.projected, fitted), _freedom(problem, fitted)
    places = [
        _place(name, "joint", fitted, columns[:, :, i * BINS : (i + 1) * BINS], *total) for i, name in enumerate(dofs)
    ]
    places += [
        _place(channel, "channel", fitted, _channel(problem, i), *total)
        for i, channel in enumerate(problem.simulator.recording.channels)
    ]
    places.sort(key=lambda p: p.freedom - p.explained)
    force, deviation, chance = _force(fitted, columns, len(dofs))
    modes = _modes(force / chance, pulses.mode)
    dof = next((dofs.index(p.name) for p in places if p.kind == "joint"), 0)
    states = _states(force[..., dof], deviation[..., dof], pulses.qvel[..., dof])
    sentence = _sentence(places, modes, states)
    return Location(
        places, force, deviation, pulses.time, pulses.qpos, pulses.qvel, pulses.mode, modes, states, dofs, sentence
    )


def _channel(problem: Problem, channel: int) -> np.ndarray:
    """Columns that absorb any error of one channel that lasts a bin, (w, m, BINS)."""
    width, length = problem.windows.measured.shape[2], problem.windows.length
    edges = np.linspace(0, length, BINS + 1).astype(int)
    columns = np.zeros((len(problem.windows.runs), length, width, BINS))
    for i, (first, last) in enumerate(pairwise(edges)):
        columns[:, first:last, channel, i] = 1.0 / problem.noise[:, first:last, channel]
    return problem.extend(columns.reshape(len(columns), -1, BINS))


def _freedom(problem: Problem, fitted: Fit) -> float:
    """Squares that noise alone would leave: samples, less what initial states take of them, less parameters."""
    samples = np.isfinite(problem.windows.measured).sum()
    taken = (fitted.linear.basis[:, : problem.windows.measured[0].size] ** 2).sum()
    return max(float(samples - taken - fitted.linear.raw.shape[2]), 1.0)


def _place(name: str, kind: str, fitted: Fit, columns: np.ndarray, total: float, freedom: float) -> Place:
    linear = fitted.linear
    basis, size = _orthonormal(linear.off(columns))
    left = linear.off(fitted.point.residual)
    left = left - np.einsum("wmb,wb->wm", basis, np.einsum("wmb,wm->wb", basis, left))
    slopes = linear.projected - basis @ (basis.transpose(0, 2, 1) @ linear.projected)
    remaining = (left**2).sum() - _refitted(left, slopes, fitted)
    explained = total - remaining
    # Within what chance makes of it there is nothing to share.
    excess = max(total - freedom, np.sqrt(2 * freedom))
    return Place(name, kind, float(explained), float(size), float(np.clip((explained - size) / excess, 0.0, 1.0)))


def _refitted(left: np.ndarray, slopes: np.ndarray, fitted: Fit) -> float:
    """Further fall of the sum of squares when the parameters move, within their prior."""
    if not slopes.shape[2]:
        return 0.0
    scale, coordinates = fitted.coordinates.scale, fitted.coordinates
    hessian = np.einsum("wma,wmb->ab", slopes, slopes) + np.diag(coordinates.sd**-2.0)
    bent = (coordinates.read(fitted.point.hypothesis) - coordinates.mean) / coordinates.sd**2
    slope = (np.einsum("wma,wm->a", slopes, left) - bent) * scale
    scaled = hessian * np.outer(scale, scale)
    return float(slope @ np.linalg.lstsq(scaled, slope, rcond=1e-12)[0])


def _orthonormal(columns: np.ndarray) -> tuple[np.ndarray, int]:
    basis, values, _ = np.linalg.svd(columns, full_matrices=False)
    used = values > RIDGE * values.max(initial=1e-300)
    return basis * used[:, None, :], int(used.sum())


def _force(fitted: Fit, columns: np.ndarray, nv: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Posterior mean and deviation of the residual force, (w, BINS, nv), under a prior as wide as it turns out, and the
    deviation that noise alone gives the mean: less, because the prior holds it."""
    free, left = fitted.linear.off(columns), fitted.linear.off(fitted.point.residual)
    scale = 1 / np.maximum(np.sqrt((free**2).sum((0, 1)) / len(free)), 1e-300)
    free = free * scale
    gram, along = np.einsum("wma,wmb->wab", free, free), np.einsum("wma,wm->wa", free, left)
    width = max(float((along**2).sum() / np.maximum((gram.diagonal(0, 1, 2) ** 2).sum(), 1e-300)), 1e-6)
    covariance = np.linalg.inv(gram + np.eye(gram.shape[1]) / width)
    mean = np.einsum("wab,wb->wa", covariance, along) * scale
    deviation = np.sqrt(covariance.diagonal(0, 1, 2)) * scale
    by_noise = (covariance @ gram @ covariance).diagonal(0, 1, 2)
    chance = np.sqrt(np.maximum(by_noise, np.finfo(float).tiny)) * scale
    shape = (len(free), nv, BINS)
    return tuple(part.reshape(shape).transpose(0, 2, 1) for part in (mean, deviation, chance))


def _modes(standard, mode) -> dict[str, float]:
    """Mean squared residual force in each contact mode, in variances of what noise makes of it, less the 1 that noise
    has: of all degrees of freedom, for the largest of several has more."""
    squares = (standard**2).mean(-1)
    return {str(m): float(max(squares[mode == m].mean() - 1.0, 0.0)) for m in np.unique(mode)}


def _states(force, deviation, speed) -> dict[str, float]:
    """How the residual force of one joint goes with state: correlations with direction, speed and slow motion."""
    weight, size = 1 / deviation**2, np.sqrt(np.mean(speed**2)) or 1.0
    regressors = {
        "direction of motion": np.sign(speed),
        "speed": speed,
        "reversals": np.sign(speed) * (np.abs(speed) < SLOW * size),
        "constant": np.ones_like(speed),
    }
    return {name: _correlation(force, x, weight) for name, x in regressors.items()}


def _correlation(y, x, weight) -> float:
    norm = np.sqrt((weight * x * x).sum() * (weight * y * y).sum())
    return float((weight * x * y).sum() / norm) if norm > 0 else 0.0


def _sentence(places: list[Place], modes: dict[str, float], states: dict[str, float]) -> str:
    first = places[0]
    clean = [p.name for p in places if p.kind == first.kind and p.share < 0.3 * first.share]
    mode = f", most in {max(modes, key=modes.get)} motion" if len(modes) > 1 else ""
    state = max(states, key=lambda name: abs(states[name]))
    going = f", going with {state}" if abs(states[state]) > 0.4 and first.kind == "joint" else ""
    rest = f"; {', '.join(clean)} {'are' if len(clean) > 1 else 'is'} clean" if clean else ""
    return f"{first.name} ({first.share:.0%} of what is unexplained){mode}{going}{rest}"
