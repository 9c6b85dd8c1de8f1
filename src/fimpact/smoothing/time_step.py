"""The time step of a track: as fine as it must be for its error to move no reading."""

from collections.abc import Callable, Sequence

import numpy as np

from fimpact.deciding import DOUBT, SHARE
from fimpact.effects.base import Placed
from fimpact.effects.touching import can_touch
from fimpact.recordings import Recording, Run
from fimpact.simulation.simulator import Simulator
from fimpact.smoothing.dynamics.plant import plant_of
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States

FINEST = 32  # parts of the model's time step at most


def refined(
    recording: Recording,
    runs: Sequence[Run],
    begin: Callable,
    noise: np.ndarray,
    refine: int = 0,
    placed: Sequence[Placed] = (),
) -> tuple[Track, States]:
    """The track at a time step whose error moves no reading, and the states to begin with.

    Where nothing touches along the measured motion, nothing is simulated that might: looking for contacts of meshes
    takes longer than all else, and their time step is fine.

    Args:
        begin: of a track, the states that the measurements show. refine: parts of the model's step, 0: as needed.
        placed: effects that are known already.
    """
    if refine:
        asked = Track(Simulator(recording, refine), runs)
        return asked, begin(asked)
    refine, apart = 1, False
    track: Track | None = None
    states: States | None = None
    errors: list[float] = []
    while True:
        finer = Track(Simulator(recording, refine, apart), runs)
        if finer.simulator.substeps < 2:
            refine *= 2
            continue
        if states is None:
            states = begin(finer)
            apart = can_touch(finer.model) and not finer.touching(states).any()
            finer = Track(Simulator(recording, refine, apart), runs) if apart else finer
        if track is not None:
            errors.append(halving_error(track, finer, states, noise, placed))
            if errors[-1] < DOUBT:
                return track, states
        # Contact may have an error that falls slowly: where the finest is not fine enough, none in between is asked.
        if can_touch(finer.model) and len(errors) > 1 and _ends_at(errors, FINEST / refine) > DOUBT:
            return Track(Simulator(recording, FINEST, apart), runs), states
        track, refine = finer, 2 * refine
        if refine > FINEST:
            return track, states


def _ends_at(errors: Sequence[float], finer: float) -> float:
    """The error of a step so many times `finer`, where each halving does what the last one did."""
    return errors[-1] * (errors[-1] / errors[-2]) ** np.log2(finer)


def halving_error(track: Track, finer: Track, states: States, noise: np.ndarray, placed: Sequence[Placed]) -> float:
    """Measure how far half the time step moves readings a sample later, root sum of squares over all of them, beside
    their noise and the least share that is asked for of what the model misses."""
    ends = []
    for own in (track, finer):
        still = np.zeros_like(states.qvel), np.ones_like(states.qvel)
        plant = plant_of(own, placed, own.simulator.theta, states, *still)
        after = plant.step(states, plant.tau).after
        ends.append(plant.step(after, plant.tau).readings)
    next_rows = np.flatnonzero(~track.last)
    missed = ends[1][next_rows] - track.measured[next_rows + 1]
    scale = np.sqrt(noise**2 + SHARE * np.nanmedian(missed**2, axis=0))
    off = (ends[1] - ends[0]) / scale
    known = ~own.late & np.isfinite(off).all(0)
    return float(np.sqrt(np.sum(np.minimum(off[:, known] ** 2, 1e12)))) if known.any() else 0.0
