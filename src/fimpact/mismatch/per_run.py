"""Held-out error run by run, in the unit of what was measured.

Channels in different units have no error in common: told is that of the unit which most of them have.
"""

from collections import Counter

import numpy as np

from fimpact.mismatch.evidence import residuals
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.units import channel_unit

NOISE = "sd of noise"  # in place of a unit, where no channel has one
UNKNOWN = 1e-6  # weight up to which an initial state counts as fitted from the data alone


def unit_of(bench: Bench) -> str:
    """The unit that most channels have, the first of them where several are as many; `NOISE` where none has one."""
    counted = Counter(unit for unit in _units(bench) if unit)
    return counted.most_common(1)[0][0] if counted else NOISE


def error_per_run(bench: Bench, judged: Fit) -> dict[str, float]:
    """Root mean square error of each held-out run under `judged`, in `unit_of`; NaN where the simulation diverged."""
    problem, scale = bench.held_out, _scale(bench)
    error = residuals(bench, judged) * problem.noise / bench.noise * scale
    seen = np.isfinite(problem.windows.measured) & (scale > 0)
    with np.errstate(over="ignore", invalid="ignore"):
        return {name: _finite(np.sqrt(np.mean(error[at][seen[at]] ** 2))) for name, at in _runs(bench)}


def floor_per_run(bench: Bench) -> dict[str, float]:
    """What noise alone leaves of each held-out run once its initial states are fitted, in `unit_of`."""
    problem, scale = bench.held_out, _scale(bench)
    seen = np.isfinite(problem.windows.measured)
    states, out = (problem.start_weight <= UNKNOWN).sum(1), {}
    for name, at in _runs(bench):
        told = seen[at] & (scale > 0)
        free = max(0.0, 1 - states[at].sum() / seen[at].sum())
        out[name] = float(np.sqrt(free * (told * scale**2).sum() / told.sum()))
    return out


def _units(bench: Bench) -> list[str]:
    simulator = bench.training.simulator
    return [channel_unit(simulator.base, channel) for channel in simulator.recording.channels]


def _scale(bench: Bench) -> np.ndarray:
    """What one standard deviation of noise is of `unit_of`, (ny,); 0 in channels of another unit."""
    unit = unit_of(bench)
    same = np.array([unit in (NOISE, own) for own in _units(bench)])
    return np.where(same, 1.0 if unit == NOISE else bench.noise, 0.0)


def _runs(bench: Bench) -> list[tuple[str, np.ndarray]]:
    """Names of the held-out runs that have windows, and which windows those are."""
    windows = bench.held_out.windows
    which = [(name, windows.runs == i) for i, name in enumerate(windows.names)]
    return [(name, at) for name, at in which if np.isfinite(windows.measured[at]).any()]


def _finite(value: float) -> float:
    return float(value) if np.isfinite(value) else float("nan")
