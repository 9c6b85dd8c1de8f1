"""How late position servos follow their targets, and how much softer they are, before anything else is asked.

A servo that is told something old pushes as hard as it can, and what it does no longer follows from how late it is: no
derivative finds the delay, nor, beside one that is wrong, the gain. Simulation of short windows for each choice does.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from fimpact.deciding import BELIEF, REFINES
from fimpact.effects.base import Effect, Placed
from fimpact.effects.families.actuation import EFFECTS as OF_MOTORS
from fimpact.effects.families.servos import EFFECTS as OF_SERVOS
from fimpact.effects.sites import ALL
from fimpact.effects.typical import late as typical
from fimpact.effects.wiring import has_servos
from fimpact.simulation.simulator import Simulator
from fimpact.smoothing.dynamics.plant import plant_of
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States

LATE = {"command_delay": "delay", "actuator_lag": "time"}  # effects and what says how late
CHOICES = 12  # at most, from half a sample up to the latest that is believed; what is less has a derivative
FEW = 100  # windows that show roughly how late a servo is
AHEAD = 4  # samples of a window: a servo has long forgotten a wrong first speed, and windows tell how stiff it is
Way = tuple[Placed, ...]  # in which servos are late: how late, and the gains of all of them


def lateness(track: Track, begun: States, noise: np.ndarray) -> tuple[Way, ...]:
    """Dead time and first-order lag of all servos as short windows show them, best first; empty where the best does not
    take away nearly all of the squared misfit of the next sample: what drives lack may look like a lag, but not for all
    of it.

    Each alone comes before the same beside a common change of the gains, which looks like a little lateness itself, if
    that takes its share of what is left.

    Args:
        begun: states that the measurements show, (N,). noise: sd of the readings, (ny,).
    """
    if not has_servos(track.model):
        return ()
    track = _at_its_own_step(track)
    misfit = _Misfit(track, begun, noise)
    alone = [(misfit(way), way) for way in (_latest(track, misfit, *asked) for asked in _asked(track))]
    best, first = min(alone, default=(np.inf, ()), key=lambda own: own[0])
    soon = _Misfit(track, begun, noise, 1)  # what drives lack adds up over a window like a lag
    if not first or soon(first) > soon(()) + np.log(REFINES):
        return ()
    believed = sorted((own for own in alone if own[0] < best - np.log(REFINES)), key=lambda own: own[0])
    ways = []
    for most, late in believed:
        softer = _softer(track, misfit, late)
        ways += [late, softer] if misfit(softer) < most + np.log(1 - REFINES) else [late]
    return tuple(ways)


def _at_its_own_step(track: Track) -> Track:
    """The same at the time step that the model itself has, or half of that if it is the whole sample."""
    simulator = track.simulator
    least = 1 if simulator.substeps >= 2 * simulator.refine else min(2, simulator.refine)
    return Track(Simulator(track.recording, least, simulator.apart), track.runs)


def _asked(track: Track) -> list[tuple[Effect, str]]:
    """Effects by which all servos may be late, and where."""
    model, found = track.model, []
    for effect in (effect for effect in OF_MOTORS if effect.name in LATE):
        sites = effect.sites(model, track.recording.channels)
        found += [(effect, ALL)] if ALL in sites else [(effect, sites[0])] if sites and model.nu == 1 else []
    return found


def _latest(track: Track, misfit: Callable, effect: Effect, site: str) -> Way:
    """The time that leaves least."""
    half, latest = 0.5 * track.period, 2 * typical(track.period)
    times = np.linspace(half, latest, min(CHOICES, round(latest / half)))

    def way(time: float) -> Way:
        return (Placed(effect, site, {LATE[effect.name]: float(time)}),)

    best = times[np.argmin([misfit(way(time), FEW) for time in times])]
    bounds = (max(best - half, half), best + half)
    near = minimize_scalar(lambda time: misfit(way(time)), bounds=bounds, method="bounded", options={"maxiter": 6})
    return way(near.x)


def _softer(track: Track, misfit: Callable, late: Way) -> Way:
    """The same and a common change of all servos' gains, as far as it is believed, both where they leave least."""
    (effect,) = (effect for effect in OF_SERVOS if effect.name == "servo_kp")
    sites, period = effect.sites(track.model, track.recording.channels), track.period
    (name, time), most = *late[0].values.items(), BELIEF * effect.prior(None, track.model, "")["change"]  # type: ignore[arg-type]
    begin = np.array([time, 0.0])

    def way(at: np.ndarray) -> Way:
        gains = (Placed(effect, site, {"change": float(at[1])}) for site in sites)
        return (replace(late[0], values={name: float(at[0])}), *gains)

    simplex = begin + np.array([[0.0, 0.0], [-period / 4, 0.0], [0.0, -most / 2]])
    bounds, own = [(0.0, None), (-most, most)], {"initial_simplex": simplex, "maxfev": 25, "xatol": 1e-3, "fatol": 1e-2}
    # The stubs of scipy do not know these options.
    found = minimize(lambda at: misfit(way(at), FEW), begin, method="Nelder-Mead", bounds=bounds, options=own)  # type: ignore[call-overload]
    return way(found.x)


class _Misfit:
    """Logarithm of the squared misfit of readings in windows of a few samples, beside their noise; mean over the
    channels."""

    def __init__(self, track: Track, begun: States, noise: np.ndarray, ahead: int = AHEAD):
        self.track, self.begun, self.noise, self.ahead = track, begun, noise, ahead
        firsts = [np.arange(part.start, part.stop - ahead, ahead) for part in track.slices()]
        self.rows = np.concatenate(firsts)

    def __call__(self, placed: Sequence[Placed], windows: int = 0) -> float:
        """Of all windows, or of about so many, spread evenly."""
        track, begun = self.track, self.begun
        rows = self.rows[:: max(len(self.rows) // windows, 1)] if windows else self.rows
        still, doubt = np.zeros_like(begun.qvel), np.ones_like(begun.qvel)
        plant = plant_of(track, placed, track.simulator.theta, begun, still, doubt)
        models, states, missed = plant.plain.models, begun[rows], []
        for ahead in range(self.ahead):
            now = rows + ahead
            states = track.ahead(models, states, plant.ctrl[now], plant.force[now]).after
            missed.append(track.read(models[0], states, plant.ctrl[now + 1]) - track.measured[now + 1])
        left = np.concatenate(missed) if len(rows) else np.empty((0, len(self.noise)))
        known = ~track.late & np.isfinite(left).any(0)
        seen = np.log(np.nanmean(left[:, known] ** 2, 0) + self.noise[known] ** 2) if known.any() else np.zeros(1)
        return float(np.nan_to_num(seen.mean(), nan=np.inf))
