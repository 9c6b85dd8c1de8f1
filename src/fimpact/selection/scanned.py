"""Where a law has no slope: the value of its one coefficient that fits best what is left, among all that differ.

A target that is rounded to steps is another sequence for every step, and neighbours of the true one tell nothing of it:
as with the frequency of a sine, a periodogram finds what no descent does (Lomb, Astrophysics and Space Science 39,
1976). Chance is judged over all values that were looked at.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fimpact.effects.gears import encoders
from fimpact.smoothing.candidates import Candidate
from fimpact.smoothing.filter.by_run import variances
from fimpact.smoothing.smoother import Smoothed

POINTS = 2000  # samples that a scan looks at
FINEST = 1 / 2500  # of what is commanded at most: finer values are not scanned, however quiet the readings
AT_ONCE = 200  # values whose laws are held in memory together


def scanned(fit: Smoothed, tried: Sequence[Candidate]) -> list[Candidate]:
    """Each of `tried` whose law wants it, once, with the value that goes best with the missing force of `fit`."""
    sites = {c.name: c for c in tried if c.effect.scan and c.effect.enters == "command"}
    if not sites:
        return []
    track = fit.track
    rows = np.arange(0, track.count, -(-track.count // POINTS))
    known = variances(track, fit.linear, fit.filter)[0][rows]  # of the missing force's pull, tau / S^2, which follow
    pull = fit.tau[rows] / np.maximum(fit.levels.forces[rows], 1e-300) ** 2
    found = [_best(fit, candidate, rows, pull, known) for candidate in sites.values()]
    return [candidate for candidate in found if candidate]


def _best(fit: Smoothed, candidate: Candidate, rows, pull, known) -> Candidate | None:
    """The value whose force, beside the commands' own, goes best with what is left at the motor's joint."""
    model, effect, site = fit.track.model, candidate.effect, candidate.site
    motor = model.actuator(site).id
    joint = int(model.actuator_trnid[motor, 0])
    given = fit.linear.plant.ctrl.mean[rows, motor][None, :, None]
    read = np.isin(fit.track.simulator.columns, encoders(model, model.joint(joint).name)[0])
    farthest = float(np.abs(given).max())
    # Half a step is what is read wrongly.
    finest = max(2 * float(fit.levels.reading[read].min(initial=np.inf)), FINEST * farthest)
    if not finest < farthest:
        return None
    dof = model.jnt_dofadr[joint]
    signal = replace(fit.track.simulator.commands.describe(fit.track.time[None, rows], given), actuators=(site,))
    (name,) = (c.name for c in effect.coefficients)
    assert effect.scan is not None
    values = effect.scan(finest, farthest)
    fits = []
    for some in np.array_split(values, -(-len(values) // AT_ONCE)):
        force = np.array([effect.law(given, signal, site, **{name: v})[0, :, 0] for v in some]) - given[0, :, 0]
        fits.append(force @ pull[:, dof] / np.sqrt(np.maximum(force**2 @ known[:, dof], 1e-300)))
    towards = np.sign(model.actuator_gainprm[motor, 0] * model.actuator_gear[motor, 0])
    best = int(np.argmax(towards * np.concatenate(fits)))
    return replace(candidate, shapes={name: float(values[best])}, among=len(values))
