"""From a recording to the track that is smoothed: time step, first states and noise."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fimpact.recordings import Recording, Run
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.state_guess import measured_motion, noise_level
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.servo_lag import Way, lateness
from fimpact.smoothing.smoother import Smoothed, smooth
from fimpact.smoothing.states import States
from fimpact.smoothing.time_step import begun_at, settled


@dataclass(frozen=True)
class Prepared:
    """A track, the states that the measurements show, (N,), sd of the readings, (ny,), and how late motors are. known:
    the naive fit where it is known already."""

    track: Track
    begun: States
    noise: np.ndarray
    late: tuple[Way, ...] = ()
    known: Smoothed | None = None

    @cached_property
    def naive(self) -> Smoothed:
        """The fit in which only the case's unknowns are free."""
        return self.known or smooth(self.track, self.begun, self.noise)

    @cached_property
    def simulator(self) -> Simulator:
        """Simulates the model with all that may touch."""
        own = self.track.simulator
        return Simulator(own.recording, own.refine) if own.apart else own

    @cached_property
    def proving(self) -> Simulator:
        """Simulates predictions: without what may touch, where nothing does along any run, held-out ones among them."""
        own, recording = self.track.simulator, self.track.recording
        known = {run.name for run in self.track.runs}
        others = [run for run in recording.runs if run.name not in known]
        if not own.apart or not others:
            return own
        track = Track(self.simulator, others)
        return self.simulator if track.touching(measured_states(track, self.noise)).any() else own


def prepare(
    recording: Recording, runs: Sequence[Run] = (), refine: int = 0, progress: Callable[[str], None] = lambda line: None
) -> Prepared:
    """The track of `runs`, default: those that may be fitted.

    Args:
        runs: default: those that may be fitted, or as many of them as the case asks for.
        refine: parts of the model's time step; 0: as fine as it must be.
    """
    noise, runs = noise_level(recording), runs or spread_out(recording.training, recording.windows)

    def begin(track: Track) -> States:
        return measured_states(track, noise)

    track, begun = begun_at(recording, runs, begin, refine or 1)
    late = lateness(track, begun, noise)
    if refine:
        return Prepared(track, begun, noise, late)
    # What is late hides the error of the time step.
    ways = late[0] if late else ()
    priors = [dict.fromkeys(own.values, np.inf) for own in ways]
    fit = smooth(track, begun, noise, ways, priors, progress=progress, frozen=bool(late))
    fit = settled(fit, begun, noise, progress)
    fit.track.steps = 0  # what is asked for counts from here
    return Prepared(fit.track, begun, noise, late, None if late else fit)


def spread_out(runs: Sequence[Run], most: int) -> tuple[Run, ...]:
    """At most so many of `runs`, spread over all of them; 0: all."""
    if not most or len(runs) <= most:
        return tuple(runs)
    return tuple(runs[i] for i in np.linspace(0, len(runs) - 1, most).round().astype(int))


def measured_states(track: Track, noise: np.ndarray) -> States:
    """States as the measurements show them; actuators as their first commands have them."""
    model, motions = track.model, []
    for run in track.runs:
        motions.append(measured_motion(model, track.recording, run, noise)[:2])
    qpos, qvel = (np.concatenate(part) for part in zip(*motions, strict=True))
    act = np.zeros((track.count, model.na))
    for motor in range(model.nu):
        first, size = model.actuator_actadr[motor], model.actuator_actnum[motor]
        if first >= 0 and size == 1:
            act[:, first] = track.ctrl[:, 0, motor]
    return States(qpos, qvel, act)
