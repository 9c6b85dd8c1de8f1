"""The residual without a name: a smooth force of state and command, learned from what is unexplained.

Kernel ridge regression with random Fourier features (Rahimi & Recht 2007), a Gaussian process in all but name. It is
what others would add to a model that fails; here it is the yardstick for a named effect, which must predict runs of
another regime at least as well and say why.
"""

from dataclasses import dataclass, field

import numpy as np

from fimpact.effects.base import Effect, Placed, State
from fimpact.mismatch.locate import Location
from fimpact.mismatch.simulate import Simulator
from fimpact.mismatch.windows import Windows

FEATURES = 200
WIDTHS = (1.0, 2.0, 4.0)  # of the kernel, in standard deviations of the inputs
RIDGES = (1e-3, 1e-1, 1e1, 1e3)
FOLDS = 5


@dataclass(frozen=True)
class Regression:
    """Weights (FEATURES, nv) on cos(x W + b) of standardised inputs x = (qpos, qvel, ctrl)."""

    mean: np.ndarray
    spread: np.ndarray
    directions: np.ndarray
    phases: np.ndarray
    weights: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def features(self, inputs: np.ndarray) -> np.ndarray:
        """(n, FEATURES); inputs are held within what was seen, because a kernel knows nothing beyond."""
        scaled = np.clip((inputs - self.mean) / self.spread, -3.0, 3.0)
        return np.cos(scaled @ self.directions + self.phases) * np.sqrt(2 / FEATURES)

    def force(self, state: State, site: str) -> np.ndarray:
        """Generalised force, (n, nv)."""
        return self.features(np.concatenate([state.qpos, state.qvel, state.ctrl], 1)) @ self.weights


def black_box(simulator: Simulator, windows: Windows, location: Location) -> Placed:
    """The residual force of `location` as a function of state and command, ready to be simulated with."""
    index = (location.time / simulator.recording.period + 1e-9).astype(int)
    ctrl = windows.ctrl[windows.runs[:, None], np.minimum(index, windows.ctrl.shape[1] - 1)]
    parts = [location.qpos, location.qvel, ctrl]
    count = location.time.size  # a recording without commands has no numbers in that part
    inputs = np.concatenate([part.reshape(count, part.shape[2]) for part in parts], 1)
    target = location.force.reshape(-1, location.force.shape[2])
    # At the end of a window a force hardly shows: what is read there counts as little as it is sure.
    deviation = location.deviation.reshape(target.shape)
    sure = np.minimum(np.quantile(deviation, 0.25, axis=0) / np.maximum(deviation, 1e-300), 1.0)
    groups = np.repeat(np.arange(len(windows.runs)) % FOLDS, location.time.shape[1])
    if len(windows.runs) < FOLDS:  # pieces of few windows are left out where windows cannot be
        groups = np.arange(count) % FOLDS
    best = min(
        (_left_out(inputs, target, sure, groups, width, ridge), width, ridge) for width in WIDTHS for ridge in RIDGES
    )
    learned = _learn(inputs, target, sure, *best[1:])
    effect = Effect(
        "black_box", "residual", "", "", "", "force", (), lambda m, c: [], lambda s, m, k: [], learned.force, {}
    )
    return Placed(effect, "all", {})


def _learn(inputs, target, sure, width: float, ridge: float) -> Regression:
    rng = np.random.default_rng(0)
    size = inputs.shape[1]
    blank = Regression(
        inputs.mean(0),
        np.maximum(inputs.std(0), 1e-9),
        rng.standard_normal((size, FEATURES)) / width / np.sqrt(size),
        rng.uniform(0, 2 * np.pi, FEATURES),
    )
    features = blank.features(inputs)
    weights = []
    for force, own in zip(target.T, sure.T, strict=True):
        rows = features * own[:, None]
        weights.append(np.linalg.solve(rows.T @ rows + ridge * np.eye(FEATURES), rows.T @ (force * own)))
    return Regression(blank.mean, blank.spread, blank.directions, blank.phases, np.stack(weights, 1))


def _left_out(inputs, target, sure, groups, width: float, ridge: float) -> float:
    scale, error = np.maximum((target * sure).std(0), 1e-300), 0.0
    for fold in range(FOLDS):
        out = groups == fold
        learned = _learn(inputs[~out], target[~out], sure[~out], width, ridge)
        missed = (learned.features(inputs[out]) @ learned.weights - target[out]) * sure[out]
        error += float(((missed / scale) ** 2).sum())
    return error
