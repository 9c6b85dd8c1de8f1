"""How late position servos follow their targets, before anything else is asked.

A servo that is told something old pushes as hard as it can, and what it does no longer follows from how late it is: no
derivative finds the delay. One simulation of all samples for each choice of it does.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from fimpact.deciding import REFINES
from fimpact.effects.actuation import EFFECTS
from fimpact.effects.amounts import late as typical
from fimpact.effects.base import Placed
from fimpact.effects.sites import ALL, has_servos
from fimpact.smoothing.states import States
from fimpact.smoothing.track import Track

LATE = {"command_delay": "delay", "actuator_lag": "time"}  # effects and what says how late
CHOICES = 12  # at most, from half a sample up to the latest that is believed; what is less has a derivative


def lateness(track: Track, begun: States, noise: np.ndarray) -> tuple[Placed, ...]:
    """Dead time and first-order lag of all servos, each where it takes away nearly all of the squared misfit of the
    next sample, best first; empty where none does: what drives lack may look like a lag, but not for all of it.

    Args:
        begun: states that the measurements show, (N,). noise: sd of the readings, (ny,).
    """
    model, found = track.model, []
    if not has_servos(model):
        return ()
    now = _misfit(track, begun, noise, ())
    half, latest = 0.5 * track.period, 2 * typical(track.period)
    times = np.linspace(half, latest, min(CHOICES, round(latest / half)))
    for effect in (effect for effect in EFFECTS if effect.name in LATE):
        sites, coefficient = effect.sites(model, track.recording.channels), LATE[effect.name]
        for site in [ALL] if ALL in sites else sites[:1] if model.nu == 1 else []:

            def left(time: float, effect=effect, site=site, coefficient=coefficient) -> float:
                return _misfit(track, begun, noise, (Placed(effect, site, {coefficient: float(time)}),))

            best = times[np.argmin([left(time) for time in times])]
            near = minimize_scalar(
                left, bounds=(max(best - half, half), best + half), method="bounded", options={"maxiter": 8}
            )
            found.append((near.fun, Placed(effect, site, {coefficient: float(near.x)})))
    return tuple(own for most, own in sorted(found, key=lambda pair: pair[0]) if most < now + np.log(REFINES))


def by_samples(late: Placed, period: float) -> Placed:
    """The same by whole samples: a command that jumps within a sample takes steps that are finer than all else."""
    return replace(late, values={name: round(time / period) * period for name, time in late.values.items()})


def _misfit(track: Track, begun: States, noise: np.ndarray, placed: Sequence[Placed]) -> float:
    """Logarithm of the squared misfit of readings a sample ahead, beside their noise; mean over the channels."""
    still, doubt = np.zeros_like(begun.qvel), np.ones_like(begun.qvel)
    plant = track.plant(placed, track.simulator.theta, begun, still, doubt)
    plant = replace(plant, models=track.at_steps(plant.coarse.model))  # half a step late is late, too
    after = plant.step(begun, still).after
    rows = np.flatnonzero(~track.last)
    missed = plant.step(after, still).readings[rows] - track.measured[rows + 1]
    known = ~track.late & np.isfinite(missed).any(0)
    return float(np.log(np.nanmean(missed[:, known] ** 2, 0) + noise[known] ** 2).mean()) if known.any() else 0.0
