"""The proof: held-out runs, used once, by forward simulation of the naive, the freed and the improved model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fimpact.recordings import Recording, Run
from fimpact.simulation.horizon import Starts, errors
from fimpact.simulation.simulator import Hypothesis, Simulator
from fimpact.smoothing.prepare import Prepared, measured_states
from fimpact.smoothing.smoother import smooth
from fimpact.smoothing.track import Track
from fimpact.units import channel_unit

HORIZONS = 6  # at most, of the ladder
FINER = 4  # times as many steps in a proof as in a fit
QUICK = 1.0  # s: the horizon by which runs are compared where a case names none


@dataclass(frozen=True)
class Proof:
    """Held-out error against horizon. horizons: (h,) s. curves: by model and "floor", (h,), sd of noise where channels
    have several units, else in `unit`. runs: a row for each held-out run at the case's own horizon."""

    horizons: np.ndarray
    unit: str
    noise_floor: float
    curves: dict[str, np.ndarray]
    runs: tuple[dict[str, Any], ...]


def starts_of(recording: Recording, runs: Sequence[Run], noise: np.ndarray, simulator: Simulator) -> list[Starts]:
    """The states at every sample of `runs` as the measurements show them, the same for every model."""
    track = Track(simulator, runs)
    begun = measured_states(track, noise)
    found = smooth(track, begun, noise, rounds=3, frozen=True)
    nv, sd = track.model.nv, _spread(track, noise)
    out = []
    for rows in track.slices():
        doubt = np.maximum(found.doubt[rows], sd[nv : 2 * nv])
        wide = np.concatenate([np.tile(sd[:nv], (len(doubt), 1)), 3 * doubt, np.ones((len(doubt), track.space.na))], 1)
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


def held_out_errors(
    recording: Recording,
    simulator: Simulator,
    hypothesis: Hypothesis,
    noise: np.ndarray,
    starts: Sequence[Starts],
    horizons: Sequence[float],
    runs: Sequence[Run] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square error of a model, (h, runs), in the channels' unit or, of several units, in sd of noise; and the
    horizons it was taken at, (h,)."""
    runs = runs or recording.held_out
    found = errors(simulator, hypothesis, recording, runs, starts, noise, horizons)
    if unit_of(recording) == NOISE:
        return found.normalised, found.horizons
    with np.errstate(over="ignore", invalid="ignore"):
        return np.sqrt(np.mean(found.error**2, axis=2)), found.horizons


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


def prove(prepared: Prepared, models: Mapping[str, tuple[Simulator, Hypothesis]]) -> Proof | None:
    """Errors of `models` on the held-out runs; None where none were held out."""
    recording, noise = prepared.track.recording, prepared.noise
    if not recording.held_out:
        return None
    simulator = prepared.track.simulator
    starts = starts_of(recording, recording.held_out, noise, simulator)
    horizons, own = horizons_of(recording)
    curves, at_own, taken = {}, {}, np.array(horizons)
    for name, (coarse, hypothesis) in models.items():
        plant = _finer(coarse)
        found, taken = held_out_errors(plant.recording, plant, hypothesis, noise, starts, horizons)
        with np.errstate(over="ignore", invalid="ignore"):
            curves[name] = np.sqrt(np.nanmean(found**2, axis=1))
        at_own[name] = found[own]
    floor = floor_of(recording, noise)
    curves["floor"] = np.full(len(taken), floor)
    runs = tuple(
        {"run": run.name, "noise_floor": floor} | {f"error_{name}": _plain(e[i]) for name, e in at_own.items()}
        for i, run in enumerate(recording.held_out)
    )
    return Proof(taken, unit_of(recording), floor, curves, runs)


def _finer(simulator: Simulator) -> Simulator:
    """The same at a finer step: an error that a sample hardly feels adds up over a run."""
    own = Simulator(simulator.recording).base.opt.timestep / simulator.base.opt.timestep
    return Simulator(simulator.recording, FINER * max(round(own), 1))


def _plain(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
