"""Held-out error run by run, in the unit of what was measured, where all channels have one."""

import numpy as np

from fimpact.mismatch.evidence import residuals
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.units import channel_unit

NOISE = "sd of noise"  # in place of a unit, where channels have different ones
UNKNOWN = 1e-6  # weight up to which an initial state counts as fitted from the data alone


def unit_of(bench: Bench) -> str:
    """The one unit of all channels, or `NOISE`: standard deviations of each channel's noise."""
    model, channels = bench.training.simulator.base, bench.training.simulator.recording.channels
    units = {channel_unit(model, channel) for channel in channels}
    return units.pop() if len(units) == 1 and "" not in units else NOISE


def error_per_run(bench: Bench, judged: Fit) -> dict[str, float]:
    """Root mean square error of each held-out run under `judged`, in `unit_of`; NaN where the simulation diverged."""
    problem = bench.held_out
    error = residuals(bench, judged) * problem.noise / (bench.noise if unit_of(bench) == NOISE else 1.0)
    seen = np.isfinite(problem.windows.measured)
    with np.errstate(over="ignore", invalid="ignore"):
        return {name: _finite(np.sqrt(np.mean(error[at][seen[at]] ** 2))) for name, at in _runs(bench)}


def floor_per_run(bench: Bench) -> dict[str, float]:
    """What noise alone leaves of each held-out run once its initial states are fitted, in `unit_of`."""
    problem = bench.held_out
    level = np.ones_like(bench.noise) if unit_of(bench) == NOISE else bench.noise
    seen = np.isfinite(problem.windows.measured)
    power = (seen * level**2).sum((1, 2))
    states = (problem.start_weight <= UNKNOWN).sum(1)
    return {
        name: float(np.sqrt(power[at].sum() * max(0.0, 1 - states[at].sum() / seen[at].sum()) / seen[at].sum()))
        for name, at in _runs(bench)
    }


def _runs(bench: Bench) -> list[tuple[str, np.ndarray]]:
    """Names of the held-out runs that have windows, and which windows those are."""
    windows = bench.held_out.windows
    which = [(name, windows.runs == i) for i, name in enumerate(windows.names)]
    return [(name, at) for name, at in which if np.isfinite(windows.measured[at]).any()]


def _finite(value: float) -> float:
    return float(value) if np.isfinite(value) else float("nan")
