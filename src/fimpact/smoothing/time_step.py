"""How fine a time step must be: what is left of its error is weighed as any effect is."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fimpact.deciding import TIED
from fimpact.effects.touching import can_touch
from fimpact.recordings import Recording, Run
from fimpact.simulation.simulator import Simulator
from fimpact.smoothing.dynamics.plant import plant_of
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.filter.by_run import swept
from fimpact.smoothing.smoother import Smoothed, smooth
from fimpact.smoothing.states import States

FINEST = 32  # parts of the model's time step at most


def begun_at(
    recording: Recording, runs: Sequence[Run], begin: Callable[[Track], States], refine: int = 1
) -> tuple[Track, States]:
    """The track at a part of the model's time step, at most half a sample, and the states to begin with.

    Where nothing touches along the measured motion, nothing is simulated that might: looking for contacts of meshes
    takes longer than all else, and their time step is fine.

    Args:
        begin: of a track, the states that the measurements show. refine: parts of the model's step.
    """
    while (simulator := Simulator(recording, refine)).substeps < 2:
        refine *= 2
    track = Track(simulator, runs)
    states = begin(track)
    apart = can_touch(track.model) and not track.touching(states).any()
    return (Track(Simulator(recording, refine, apart), runs) if apart else track), states


def settled(fit: Smoothed, begun: States, noise: np.ndarray, progress: Callable = lambda line: None) -> Smoothed:
    """`fit`, at a time step so fine that half of it shows in no reading; at the finest, where none is.

    Args:
        begun, noise: as in `smooth`.
    """
    while fit.track.simulator.refine < FINEST and not step_error(fit) ** 2 < TIED:
        track = _at_half(fit.track)
        progress(f"smoothing: {track.simulator.substeps} time steps in a sample")
        for like in (fit if np.isfinite(fit.chi2) else None, None):
            theta, frozen = None if like is None else fit.theta, not fit.numbers
            found = smooth(track, begun, noise, fit.placed, fit.priors, like, theta, progress, frozen=frozen)
            if np.isfinite(found.chi2) or like is None:
                break
        fit = found
    return fit


def step_error(fit: Smoothed) -> float:
    """Measure how far half the time step moves all readings together beside noise and missing force, in sd: the root of
    its non-centrality, as that of any effect."""
    track, linear = fit.track, fit.linear
    if not np.isfinite(fit.chi2):
        return np.inf
    sign, ends = linear.plant.rubbing.sign, []
    for own in (track, _at_half(track)):
        plant = plant_of(own, fit.placed, fit.theta, fit.states, fit.tau, fit.doubt, sign, linear.plant.surprise)
        ends.append(plant.step(fit.states, fit.tau))
    after = linear.moved(track.space.minus(ends[1].after, ends[0].after)[:, :, None])
    left = (ends[0].readings - ends[1].readings)[:, :, None]
    if not (np.isfinite(after).all() and np.isfinite(left).all()):
        return np.inf
    # The first column has the starts of the runs in it.
    column = replace(linear, offsets=_beside_nothing(after), left=_beside_nothing(left))
    innovations, _ = swept(track, column, fit.filter, np.zeros((*fit.tau.shape, 2)))
    return float(np.linalg.norm(innovations[:, :, 1]))


def _beside_nothing(column: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.concatenate([np.zeros_like(column), column], axis=2))


def _at_half(track: Track) -> Track:
    """The same at half the time step; what was simulated so far counts on."""
    own = track.simulator
    finer = Track(Simulator(own.recording, 2 * own.refine, own.apart), track.runs)
    finer.steps = round(track.quanta * finer.count * finer.simulator.substeps)
    return finer
