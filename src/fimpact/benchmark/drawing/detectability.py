"""How visible an effect is to an oracle: its whitened trace in the training windows, nuisance projected off.

Everything here is computed on coarse copies, whose step is the naive model's.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fimpact.benchmark.drawing.tangents import PIECES, Tangents
from fimpact.benchmark.rigs.rig import Rig

SPREAD = 1e-6  # smallest information on a start, relative to its largest: keeps unseen directions solvable
White = Callable[[np.ndarray], np.ndarray]  # (W, n ny, k) -> the same in units in which noise is white


def coloured(rig: Rig, push: np.ndarray, correlation: float) -> np.ndarray:
    """Response (W, n ny, k) to unit-variance OU disturbance of this correlation time, as independent columns."""
    piece = (rig.window or rig.duration) / PIECES
    lag = np.abs(np.subtract.outer(np.arange(PIECES), np.arange(PIECES))) * piece
    root = np.linalg.cholesky(np.exp(-lag / correlation) + 1e-9 * np.eye(PIECES))
    return push @ np.kron(np.eye(rig.naive.nv), root)


def unlogged(rig: Rig, push: np.ndarray) -> np.ndarray:
    """Response (W, n ny, k) to what motor currents tell wrongly, as independent columns; none where commands are known.

    Of what is white from sample to sample, and of the ripple, which is hardly less so, a piece keeps the mean.
    """
    samples = round((rig.window or rig.duration) / PIECES / rig.period)
    dofs = [rig.naive.joint(name).dofadr[0] for name in rig.driven] if len(rig.current) else []
    told = rig.current * np.sqrt(1.5 / samples)
    parts = [
        push[:, :, PIECES * dof : PIECES * (dof + 1)] * sd / rig.disturbance[dof]
        for dof, sd in zip(dofs, told, strict=True)
    ]
    return np.concatenate([push[:, :, :0], *parts], axis=2)


def noise_of(rig: Rig, push: np.ndarray, disturbance: float, correlation: float) -> np.ndarray:
    """Whitened response (W, n ny, m) to all that moves the robot and is not logged, from that to unit forces `push`."""
    return np.concatenate([disturbance * coloured(rig, push, correlation), unlogged(rig, push)], axis=2)


def noise_inflation(rig: Rig, tangent: Tangents, response: np.ndarray) -> float:
    """By how much unit disturbance raises the mean squared whitened residual after fitting the starts."""
    information = _start_information(rig, tangent, tangent.start)
    left = response - tangent.start @ np.linalg.solve(information, _t(tangent.start) @ response)
    return float(np.sum(left**2) / (response.shape[0] * response.shape[1]))


@dataclass(frozen=True)
class Visibility:
    """Gram matrix of projected traces (k, k), and squared lengths before any and after the starts' projection (k,)."""

    gram: np.ndarray
    raw: np.ndarray
    after_start: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """Non-centrality lambda of each trace, (k,)."""
        return np.diag(self.gram)

    @property
    def concealment(self) -> tuple[np.ndarray, np.ndarray]:
        """kappa, and kappa of the unknowns alone with the starts projected off first, (k,) each."""
        tiny = np.finfo(float).tiny
        return 1 - self.size / np.maximum(self.raw, tiny), 1 - self.size / np.maximum(self.after_start, tiny)

    def left(self, one: int, other: int) -> tuple[float, float]:
        """Cosine of two projected traces, and what is left of lambda of `one` when `other` is known too."""
        cosine = self.gram[one, other] / np.sqrt(
            max(self.gram[one, one] * self.gram[other, other], np.finfo(float).tiny)
        )
        return float(cosine), float(self.gram[one, one] * (1 - cosine**2))


def visibility_of(rig: Rig, tangent: Tangents, white: White, traces: np.ndarray) -> Visibility:
    """What an oracle sees of `traces` (W, n ny, k) among noise that `white`, a `whitener`, makes white.

    The unknowns are projected off within their priors, the starts of the windows as far as they are unknown.
    """
    traces, unknown, start = (white(a) for a in (traces, _unknown(tangent), tangent.start))
    both = np.concatenate([traces, unknown], axis=2)
    cross = _t(start) @ both
    gram = np.sum(_t(both) @ both - _t(cross) @ np.linalg.solve(_start_information(rig, tangent, start), cross), axis=0)
    k = traces.shape[2]
    prior = _prior(rig, tangent)
    absorbed = gram[:k, k:] @ np.linalg.solve(gram[k:, k:] + prior, gram[k:, :k])
    return Visibility(gram[:k, :k] - absorbed, np.sum(traces**2, axis=(0, 1)), np.diag(gram)[:k])


def residual_after(rig: Rig, tangent: Tangents, white: White, traces: np.ndarray) -> np.ndarray:
    """Squares of each window, (W,), that are left of the first of `traces` (W, n ny, k) when the others, of any size,
    unknowns and starts have imitated it as far as they can; without what the priors of these cost, hence a little less
    in all than is left in `visibility_of`."""
    others = traces.shape[2] - 1
    both, start = (white(a) for a in (np.concatenate([traces, _unknown(tangent)], 2), tangent.start))
    both -= start @ np.linalg.solve(_start_information(rig, tangent, start), _t(start) @ both)
    own, rest = both[:, :, :1], both[:, :, 1:]
    gram, along = ((_t(rest) @ part).sum(0) for part in (rest, own))
    gram[others:, others:] += _prior(rig, tangent)
    return ((own - rest @ np.linalg.solve(gram, along)) ** 2).sum((1, 2))


def absorbed_by(rig: Rig, tangent: Tangents, white: White, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the unknowns, (p,), and of the starts, (W, 2 nv), that imitate the trace `change` (W, n ny, 1) best."""
    change, unknown, start = (white(a) for a in (change, _unknown(tangent), tangent.start))
    information = _start_information(rig, tangent, start)
    cross, along = _t(start) @ unknown, _t(start) @ change
    gram = np.sum(_t(unknown) @ unknown - _t(cross) @ np.linalg.solve(information, cross), axis=0)
    seen = np.sum(_t(unknown) @ change - _t(cross) @ np.linalg.solve(information, along), axis=0)
    errors = np.linalg.solve(gram + _prior(rig, tangent), seen)[:, 0]
    moved = np.linalg.solve(information, along - (cross @ errors)[:, :, None])[:, :, 0]
    return errors[: len(rig.unknowns)], moved


def oracle_sd(rig: Rig, tangent: Tangents, white: White, traces: np.ndarray) -> np.ndarray:
    """Standard deviations, (p,), in the units of `Unknown`, with which an oracle knows the unknowns in the end when the
    sizes of `traces` (W, n ny, k), starts and clocks are to be fitted too."""
    both, start = (white(a) for a in (np.concatenate([traces, _unknown(tangent)], 2), tangent.start))
    cross, k = _t(start) @ both, traces.shape[2]
    gram = np.sum(_t(both) @ both - _t(cross) @ np.linalg.solve(_start_information(rig, tangent, start), cross), axis=0)
    gram[k:, k:] += _prior(rig, tangent)
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    spread = scale * np.sqrt(np.diag(np.linalg.pinv(scale[:, None] * gram * scale)))
    return spread[k : k + len(rig.unknowns)]


def equivalent_force(rig: Rig, push: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Root mean square of the generalised force on each degree of freedom, (nv,), N or N m, that would change what is
    read by `change` (W, n ny, 1) from the same starts. push: whitened response (W, n ny, k) to unit forces."""
    size = np.sqrt(np.sum(push**2, axis=1, keepdims=True)) + np.finfo(float).tiny
    unit = push / size
    pieces = np.linalg.solve(_t(unit) @ unit + SPREAD * np.eye(push.shape[2]), _t(unit) @ change)[:, :, 0] / size[:, 0]
    return np.sqrt(np.mean(pieces.reshape(len(pieces), -1, PIECES) ** 2, axis=(0, 2))) * rig.disturbance


def _unknown(tangent: Tangents) -> np.ndarray:
    return np.concatenate([tangent.unknown, tangent.clock], axis=2)


def _prior(rig: Rig, tangent: Tangents) -> np.ndarray:
    return np.diag([*(u.sd**-2.0 for u in rig.unknowns), *np.ones(tangent.clock.shape[2])])


def _t(array):
    return array.transpose(0, 2, 1)


def _start_information(rig, tangent, start):
    gram = _t(start) @ start
    ridge = SPREAD * gram.max(axis=(1, 2))[:, None, None] * np.eye(start.shape[2]) * 1e-4
    return gram + ridge + tangent.opens[:, None, None] * np.diag(rig.start_sd**-2.0)


def whitener(noise: np.ndarray) -> White:
    """Inverse root of 1 + noise noise^T, window by window: makes white what disturbance `noise` (W, n ny, m) and white
    noise add to measurements."""
    q, s, _ = np.linalg.svd(noise, full_matrices=False)
    shrink = 1 - 1 / np.sqrt(1 + s**2)
    return lambda a: a - q @ (shrink[:, :, None] * (_t(q) @ a))
