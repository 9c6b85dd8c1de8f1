"""The proof: held-out runs, used once, by forward simulation of the naive, the freed and the improved model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from fimpact.recordings import Recording, Run
from fimpact.simulation.horizon import errors_of, windows_of
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.window_fit import Fit, Starts, fit_windows, refit, step_error, window_starts
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.prepare import Prepared, measured_states
from fimpact.smoothing.smoother import smooth
from fimpact.support.channel_units import channel_unit

HORIZONS = 6  # at most
FINER = 4  # times as many steps in a proof as in a fit, at most
CHANGED = 0.05  # of a model's error: steps that change less than that are fine enough
FEW = 4  # windows in which that is tried
QUICK = 1.0  # s: the horizon by which runs are compared where a case names none


@dataclass(frozen=True)
class Proof:
    """Held-out error against horizon. horizons: (h,) s. curves: by model and "floor", (h,), sd of noise where channels
    have several units, else in `unit`. runs: a row for each held-out run at the case's own horizon. starts: states of
    each held-out run as measured."""

    horizons: np.ndarray
    unit: str
    noise_floor: float
    curves: dict[str, np.ndarray]
    runs: tuple[dict[str, Any], ...]
    starts: tuple[Starts, ...] = ()


def starts_of(recording: Recording, runs: Sequence[Run], noise: np.ndarray, simulator: Simulator) -> list[Starts]:
    """The states at every sample of `runs` as the measurements show them, the same for every model."""
    track = Track(simulator, runs)
    begun = measured_states(track, noise)
    found = smooth(track, begun, noise, rounds=3, frozen=True)
    nv, sd = track.model.nv, _spread(track, noise)
    out = []
    for rows in track.slices():
        doubt = np.maximum(found.doubt[rows], sd[nv : 2 * nv])
        wide = np.concatenate([np.tile(sd[:nv], (len(doubt), 1)), 3 * doubt, np.ones((len(doubt), track.model.na))], 1)
        states = found.states[rows]
        out.append(Starts(states.qpos, states.qvel, states.act, wide))
    return out


def _spread(track: Track, noise: np.ndarray) -> np.ndarray:
    """sd of positions and speeds, (2 nv,), by the noise of the channels that show positions."""
    nv = track.model.nv
    known = np.full(nv, float(np.max(noise)))
    for column, channel in enumerate(track.recording.channels):
        sensor = track.model.sensor(channel.partition("[")[0])
        if int(sensor.objtype[0]) == 3:  # mjOBJ_JOINT
            known[int(track.model.jnt_dofadr[int(sensor.objid[0])])] = noise[column]
    return np.concatenate([3 * known, known])


NOISE = "σ"


def unit_of(recording: Recording) -> str:
    """The one unit of all channels, or "σ", standard deviations of noise."""
    model = recording.spec().compile()
    units = {channel_unit(model, name) for name in recording.channels}
    return units.pop() if len(units) == 1 and units != {""} else NOISE


def floor_of(recording: Recording, noise: np.ndarray) -> float:
    """The noise, in the unit of the errors."""
    return 1.0 if unit_of(recording) == NOISE else float(np.sqrt(np.mean(noise**2)))


def horizons_of(recording: Recording) -> tuple[list[float], int]:
    """Horizons, s, and the index of the one by which runs are compared."""
    longest = max(len(run.measured) for run in recording.held_out) * recording.period
    own = recording.window if 0 < recording.window < longest else min(QUICK, longest)
    steps = np.geomspace(min(max(0.1, 4 * recording.period), longest), longest, HORIZONS - 1)
    found = sorted({round(float(h), 6) for h in (*steps, own)})
    return found, found.index(round(float(own), 6))


def prove(
    prepared: Prepared,
    models: Mapping[str, tuple[Simulator, Hypothesis]],
    own_only: bool = False,
    progress: Callable[[str], None] = lambda line: None,
) -> Proof | None:
    """Measure errors of `models` on the held-out runs; None where none were held out.

    Args:
        own_only: at the case's own horizon and no other. progress: receives a line for each model and horizon.
    """
    recording, noise = prepared.track.recording, prepared.noise
    if not recording.held_out:
        return None
    starts = starts_of(recording, recording.held_out, noise, prepared.track.simulator)
    horizons, own = horizons_of(recording)
    horizons, own = ([horizons[own]], 0) if own_only else (horizons, own)
    begun = [(w, window_starts(w, starts)) for w in windows_of(recording, recording.held_out, horizons)]
    fits: dict[str, list[Fit]] = {name: [] for name in models}
    for done, (name, own_windows) in enumerate(product(models, begun), 1):
        fits[name].append(fit_windows(*models[name], *own_windows, noise))
        progress(f"proving: {done} of {len(models) * len(begun)} horizons of all models simulated")
    found = {name: errors_of(own, recording.period) for name, own in _refined(models, fits).items()}
    alone, floor = unit_of(recording) == NOISE, floor_of(recording, noise)
    with np.errstate(over="ignore", invalid="ignore"):
        each = {n: e.normalised if alone else np.sqrt(np.mean(e.error**2, axis=2)) for n, e in found.items()}
        curves = {name: np.sqrt(np.nanmean(errors**2, axis=1)) for name, errors in each.items()}
    taken = next((e.horizons for e in found.values()), np.array(horizons))
    curves["floor"] = np.full(len(taken), floor)
    runs = tuple(
        {"run": run.name, "noise_floor": floor} | {f"error_{name}": _plain(e[own][i]) for name, e in each.items()}
        for i, run in enumerate(recording.held_out)
    )
    return Proof(taken, unit_of(recording), floor, curves, runs, tuple(starts))


def _refined(models: Mapping[str, tuple[Simulator, Hypothesis]], fits: dict[str, list[Fit]]) -> dict[str, list[Fit]]:
    """The fits at a step so fine that half of it would move no model's prediction over the longest horizon by much.

    A step's error that a sample hardly feels adds up over a run. The step of all is that of the model that needs the
    finest; the starts found at the coarser one are where those at the finer one begin.
    """
    twice = {name: (_finer(simulator, 2), hypothesis) for name, (simulator, hypothesis) in models.items()}
    moved, factor = max((step_error(fits[name][-1], *own, FEW) for name, own in twice.items()), default=0.0), 1
    while moved > CHANGED and factor < FINER:
        moved, factor = moved / 2, 2 * factor  # of the first order
    if factor == 1:
        return fits
    finer = {name: (_finer(simulator, factor), hypothesis) for name, (simulator, hypothesis) in models.items()}
    return {name: [refit(fit, *finer[name]) for fit in own] for name, own in fits.items()}


def _finer(simulator: Simulator, factor: int) -> Simulator:
    """The same at a step a `factor` finer."""
    own = Simulator(simulator.recording).base.opt.timestep / simulator.base.opt.timestep
    return Simulator(simulator.recording, factor * max(round(own), 1), simulator.apart)


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
