"""A missing force without a name: a smooth function of state and command, learned from what a smoother found.

Kernel ridge regression with random Fourier features (Rahimi & Recht 2007), a Gaussian process in all but name. It is
what others would add to a model that fails; here it is the yardstick for a named effect.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from fimpact.effects.base import Effect, Placed
from fimpact.effects.law_inputs import State

FEATURES = 200
WIDTHS = (1.0, 2.0, 4.0)  # of the kernel, in standard deviations of the inputs
RIDGES = (1e-3, 1e-1, 1e1, 1e3)
FOLDS = 5
SEEN = 3.0  # standard deviations of the inputs: a kernel knows nothing beyond


@dataclass(frozen=True)
class Features:
    """Random features cos(x W + b) of standardised inputs x = (qpos, qvel, ctrl)."""

    mean: np.ndarray
    spread: np.ndarray
    directions: np.ndarray
    phases: np.ndarray

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """(n, FEATURES), inputs held within what was seen."""
        scaled = np.clip((inputs - self.mean) / self.spread, -SEEN, SEEN)
        return np.cos(scaled @ self.directions + self.phases) * np.sqrt(2 / FEATURES)


@dataclass(frozen=True)
class LearnedForce:
    """Generalised force that is linear in random features; weights (FEATURES, nv)."""

    features: Features
    weights: np.ndarray

    def __call__(self, state: State, site: str) -> np.ndarray:
        """Generalised force, (n, nv)."""
        return self.features(np.concatenate([state.qpos, state.qvel, state.ctrl], 1)) @ self.weights


def learn_force(inputs: np.ndarray, force: np.ndarray, groups: np.ndarray) -> Placed:
    """Learn `force` (n, nv) from `inputs` (n, nq + nv + nu), ready to be simulated with.

    Width and ridge predict best what groups, (n,), of samples were left out: runs, or pieces of them.
    """
    folds = np.unique(groups, return_inverse=True)[1] % FOLDS
    if not folds.any():  # a single run: its pieces
        folds = np.arange(len(inputs)) * FOLDS // len(inputs)
    missed = _left_out(inputs, force, folds)
    best = min(product(WIDTHS, RIDGES), key=lambda pair: missed[pair])
    features = _features(inputs, best[0])
    law = LearnedForce(features, _ridge(features(inputs), force, best[1]))
    effect = Effect("black_box", "residual", "", "", "", "force", (), lambda m, c: [], lambda s, m, k: [], law, {})
    return Placed(effect, "all", {})


def _features(inputs: np.ndarray, width: float) -> Features:
    rng, size = np.random.default_rng(0), inputs.shape[1]
    directions = rng.standard_normal((size, FEATURES)) / width / np.sqrt(size)
    spread = np.maximum(inputs.std(0), 1e-9)
    return Features(inputs.mean(0), spread, directions, rng.uniform(0, 2 * np.pi, FEATURES))


def _ridge(rows: np.ndarray, force: np.ndarray, ridge: float) -> np.ndarray:
    return np.linalg.solve(rows.T @ rows + ridge * np.eye(rows.shape[1]), rows.T @ force)


def _left_out(inputs: np.ndarray, force: np.ndarray, folds: np.ndarray) -> dict[tuple[float, float], float]:
    """Squared error in samples left out, by width and ridge; each coordinate in its own standard deviation."""
    force, found = force / np.maximum(force.std(0), 1e-300), {}
    for width in WIDTHS:
        rows = _features(inputs, width)(inputs)
        for ridge in RIDGES:
            kept = [folds != fold for fold in np.unique(folds)]
            weights = [_ridge(rows[own], force[own], ridge) for own in kept]
            missed = [rows[~own] @ w - force[~own] for own, w in zip(kept, weights, strict=True)]
            found[width, ridge] = float(sum((m**2).sum() for m in missed))
    return found
