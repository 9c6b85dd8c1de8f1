"""Everything a column: what a unit of each parameter and hypothesis does to the next sample and to the readings.

A force law acts along the smoothed motion; an edit of the model is the difference of one simulation of all samples;
dry friction is taken at the expected sign of the speed, and what scales the motor's torque at the torque that the model
predicts: the applied torque is an output, and a column of it would explain everything.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from fimpact.effects.base import Placed, Scales
from fimpact.simulation.nonsmooth import stop_within_a_step
from fimpact.smoothing.candidates import Candidate, needed_of_motors, scales_along
from fimpact.smoothing.dynamics.inverse import edits
from fimpact.smoothing.dynamics.laws import (
    DRY,
    acts_of,
    expected_sign,
    middle,
    predicted_commands,
    read_by,
    speed_doubt,
)
from fimpact.smoothing.dynamics.linear import Linear, inverse_of_push
from fimpact.smoothing.dynamics.response import Change, Response
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.filter.by_run import swept
from fimpact.smoothing.simulated_laws import Simulated
from fimpact.smoothing.smoother import Smoothed

ACTING = ("force", "friction", "gear")  # ways in which laws act along a motion, without a simulation
SMALL = 1e-2  # share of its prior at which a linear effect is tried: in contact no tangent holds for all of it


@dataclass(frozen=True)
class Columns:
    """Whitened columns of a smoothed recording; the first is the data's, then its p parameters', then candidates'.

    innovations: (N, ny, 1 + p + c), sensitivities with their sign so that data = columns @ values. forces: (N, nv,
    1 + p + c), the posterior missing force of each in the same sense. owners: (candidate, amplitude) of each of the c
    columns, which are in units of the prior's sd. whole: (N, nv, p + c), under stiff servos, the force that would do
    what a unit of each does: of that the smoother sees no more than its noise lets through.
    """

    innovations: np.ndarray
    forces: np.ndarray
    candidates: tuple[Candidate, ...]
    owners: tuple[tuple[int, int], ...]
    whole: np.ndarray | None = None

    def of(self, candidate: int) -> list[int]:
        """Columns, counted from the first candidate's, of one candidate."""
        return [i for i, (owner, _) in enumerate(self.owners) if owner == candidate]


def columns(smoothed: Smoothed, tried: Sequence[Candidate], known: Simulated | None = None) -> Columns:
    """Whitened columns of everything that is tried; what changes nothing, or diverges, is left out.

    Args:
        known: what was simulated for earlier columns of the same track.
    """
    asked = [(index, amplitude) for index, own in enumerate(tried) for amplitude in range(len(own.names))]
    laws = units(tried)
    shares = [_share(tried[index]) for index, _ in asked]
    found = [change.scaled(1 / share) for change, share in zip(changes(smoothed, laws, known), shares, strict=True)]
    kept = [i for i, change in enumerate(found) if change.finite]
    return _swept(smoothed, [found[i] for i in kept], tuple(tried), tuple(asked[i] for i in kept))


def units(tried: Sequence[Candidate]) -> list[Placed]:
    """What is made for the columns of these candidates."""
    return [_unit(candidate, amplitude) for candidate in tried for amplitude in range(len(candidate.names))]


def _share(candidate: Candidate) -> float:
    return SMALL if candidate.effect.linear else 1.0


def _unit(candidate: Candidate, amplitude: int) -> Placed:
    """A share of the prior of one amplitude, or all of an effect that is not linear."""
    values = np.zeros(len(candidate.names))
    values[amplitude] = _share(candidate) * candidate.sd[amplitude]
    return candidate.placed(values)


def changes(smoothed: Smoothed, laws: Sequence[Placed], known: Simulated | None = None) -> list[Change]:
    """What each of `laws` does beside the plant of a smoothed recording."""
    known = known or Simulated()
    known.along(smoothed)
    made = _Maker(smoothed)
    acting = [law for law in laws if law.effect.enters in ACTING and not known.holds(law)]
    driven = smoothed.linear.plant.driven
    acts = acts_of(smoothed.track, acting, smoothed.states, smoothed.tau, smoothed.doubt, driven)
    for law, (force, readings) in zip(acting, acts, strict=True):
        known.keep(law, replace(made.response.nothing(), force=force, readings=readings))
    return [known.change(law, made) for law in laws]


def _swept(smoothed: Smoothed, changes: Sequence[Change], tried, owners) -> Columns:
    track, linear = smoothed.track, smoothed.linear
    p = linear.left.shape[2]
    whole, means = linear, np.zeros((track.count, track.model.nv, p + len(owners)))
    if changes:
        after = linear.moved(np.stack([c.after for c in changes], 2))
        left = np.stack([-c.readings for c in changes], 2)
        whole = replace(
            linear,
            offsets=np.concatenate([linear.offsets, after], 2),
            left=np.concatenate([linear.left, left], 2),
        )
        means[:, :, p:] = np.stack([c.force for c in changes], 2)
    means[:, :, 0] = -smoothed.tau
    innovations, _ = swept(track, whole, smoothed.filter, means)
    adjoint, _ = smoothed.filter.adjoint(track, whole, innovations)
    forces = -(smoothed.levels.forces**2)[:, :, None] * adjoint[:, linear.advance.shape[1] :]
    sign = np.ones(innovations.shape[2])
    sign[1:] = -1.0
    return Columns(innovations * sign, forces * sign, tried, owners, _whole(track, linear, whole, means))


def _whole(track: Track, linear: Linear, with_all: Linear, means: np.ndarray) -> np.ndarray | None:
    if not track.long:
        return None
    moved = with_all.offsets[:, : 2 * track.model.nv, 1:]
    return means[:, :, 1:] + np.matmul(inverse_of_push(track, linear), moved)


class _Maker:
    """What edits of the model, of commands and of readings do beside the plant of a smoothed recording."""

    def __init__(self, smoothed: Smoothed):
        self.smoothed, self.track = smoothed, smoothed.track
        # The trajectory of the last derivatives is as good as the last one for what they decide.
        linear = smoothed.linear
        self.response = Response(linear.plant, smoothed.states, smoothed.tau, linear.response)
        self.plant = self.response.plant
        given = self.plant.ctrl
        self.told = replace(given, values=predicted_commands(self.track, given.values, smoothed.tau))

    def __call__(self, placed: Placed) -> tuple[Change, bool]:
        """Of one effect, and whether that took a simulation."""
        before = self.response.simulated
        return self._change(placed), self.response.simulated > before

    def _change(self, placed: Placed) -> Change:
        if placed.effect.enters == "measurement":
            return self._measurement(placed)
        if placed.effect.enters == "command":
            return self.response(replace(self.plant, ctrl=self.track.commands((*self.plant.placed, placed))))
        return self._model(placed)

    def _model(self, placed: Placed) -> Change:
        before = self.plant.model
        after = copy.copy(before)
        dry = before.dof_frictionloss if self.track.long else self.plant.dry
        after.dof_frictionloss[:] = dry
        placed.effect.law(after, placed.site, **placed.values)
        rubbed = after.dof_frictionloss - dry
        if self.track.long:
            stop_within_a_step(after)
        else:
            for name in DRY:
                getattr(after, name)[:] = getattr(before, name)
        change = self.response.nothing()
        if self._exceeded(before, after):
            return change
        if edits(after, before) or (self.track.long and rubbed.any()):
            mujoco.mj_setConst(after, mujoco.MjData(after))
            scaled = not np.array_equal(before.actuator_gainprm, after.actuator_gainprm)
            change = self.response(replace(self.plant, models=(after,)), self.told if scaled else None)
        if rubbed.any() and not self.track.long:
            states = self.smoothed.states
            doubt = speed_doubt(self.track, states, self.smoothed.doubt)
            change = replace(change, force=change.force - rubbed * expected_sign(middle(self.track, states)[1], doubt))
        return change

    def _exceeded(self, before: mujoco.MjModel, after: mujoco.MjModel) -> bool:
        """Whether the motion needed more of a motor than a limit would let it give."""
        limited = np.flatnonzero((before.actuator_forcerange != after.actuator_forcerange).any(1))
        if not len(limited):
            return False
        needed = needed_of_motors(self.track, before, self.plant.ctrl.mean, self.smoothed.states, self.smoothed.tau)
        return any(needed[m] > 1.1 * np.abs(after.actuator_forcerange[m]).max() for m in limited)

    def _measurement(self, placed: Placed) -> Change:
        base = self.smoothed.linear.base
        read = read_by(self.track, placed, self.smoothed.states, base, self.smoothed.surprise)
        return replace(self.response.nothing(), readings=read.readings - base.readings)


def motion_scales(smoothed: Smoothed) -> Scales:
    """Typical magnitudes of the smoothed motion, from which probes and priors follow."""
    plant = smoothed.linear.plant
    return scales_along(smoothed.track, plant.model, smoothed.states, smoothed.tau, plant.ctrl.mean)
