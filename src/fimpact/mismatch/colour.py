"""The colour of what disturbs a robot: slow forces that differ from window to window.

A draught, a cable, a warm motor push for longer than a sample. Such a disturbance is louder than the sensors in a few
directions, those of a slow force in a window, and a score that took it for white noise would find physics in it. Its
size is read from the residual itself, pooled over all windows, so a missing effect counts as noise here at first: that
costs power and never honesty.
"""

from dataclasses import replace

import numpy as np

from fimpact.mismatch.fit import Fit
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.pulses import BINS, Pulses

CLOCK = 0.05  # of the sampling period: sd of a run's clock against that of its commands
ORDERS = 3  # a constant, a ramp and a bend; what is faster was never louder than the sensors


def coloured(problem: Problem, fitted: Fit, found: Pulses) -> Fit:
    """`fitted` with its problem in units of noise that slow forces make louder, and with a clock of its own for each
    run as further coordinates."""
    linear = replace(fitted.linear, raw=np.concatenate([fitted.linear.raw, _clocks(problem, fitted)], 2))
    directions = _directions(linear, found)
    energy = np.einsum("wmc,wm->wc", directions, linear.off(fitted.point.residual)) ** 2
    noisy = replace(linear, coloured=directions, louder=np.sqrt(np.maximum(energy.mean(0), 1.0)))
    noisy = replace(noisy, projected=noisy.off(linear.raw))
    runs = linear.raw.shape[2] - len(fitted.pull)
    prior = np.append(fitted.coordinates.sd, np.full(runs, CLOCK))
    precision = np.einsum("wma,wmb->ab", noisy.projected, noisy.projected) + np.diag(prior**-2.0)
    scale = np.append(fitted.scale, np.full(runs, CLOCK))
    return replace(fitted, linear=noisy, precision=precision, scale=scale, pull=np.append(fitted.pull, np.zeros(runs)))


def _clocks(problem: Problem, fitted: Fit) -> np.ndarray:
    """Change of the prediction by a clock that is one period late, for each run, (w, m, runs)."""
    point, windows = fitted.point, problem.windows
    predicted = problem.simulator.predict(point.hypothesis, windows, point.qpos, point.qvel)
    late = problem.whiten(-np.gradient(predicted, axis=1))
    own = windows.runs[:, None] == np.unique(windows.runs)
    return problem.extend(late[:, :, None] * own[:, None, :])


def _directions(linear, found: Pulses) -> np.ndarray:
    """Orthonormal, off the initial states, constants first, the most visible joint first: (w, m, ORDERS * nv)."""
    waves = np.polynomial.legendre.legvander(np.linspace(-1, 1, BINS), ORDERS - 1)
    free, basis = linear.off(found.columns), np.zeros((*found.columns.shape[:2], 0))
    for wave in waves.T:
        joints = free.reshape(*free.shape[:2], -1, BINS) @ wave
        for _ in range(2):  # once is not enough for directions that are nearly taken already
            joints = joints - basis @ (basis.transpose(0, 2, 1) @ joints)
        basis = np.concatenate([basis, np.linalg.svd(joints, full_matrices=False)[0]], 2)
    return basis
