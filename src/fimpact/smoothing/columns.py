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

from fimpact.effects.base import Effect, Placed, Scales
from fimpact.effects.sites import ON_JOINT
from fimpact.smoothing.filtering import swept
from fimpact.smoothing.laws import DRY, expected_sign, force_of, middle, predicted_commands, reading_of, speed_doubt
from fimpact.smoothing.linear import heavier
from fimpact.smoothing.smoother import Smoothed
from fimpact.smoothing.states import States
from fimpact.smoothing.track import Track

SMALL = 1e-2  # share of its prior at which a linear effect is tried: in contact no tangent holds for all of it


@dataclass(frozen=True)
class Candidate:
    """An effect at a site with one choice of its shapes. names: its amplitudes; sd, positive: of each, prior standard
    deviation and whether physics forbids less than nothing. sizes, ranges: of its values (`Placed`)."""

    effect: Effect
    site: str
    shapes: dict[str, float]
    names: tuple[str, ...]
    sd: tuple[float, ...]
    positive: tuple[bool, ...]
    sizes: dict[str, float]
    ranges: dict[str, tuple[float, float]]

    @property
    def name(self) -> str:
        """``effect@site``."""
        return f"{self.effect.name}@{self.site}"

    def placed(self, values: Sequence[float]) -> Placed:
        """The effect with these amplitudes."""
        amplitudes = dict(zip(self.names, map(float, values), strict=True)) if self.effect.linear else {}
        own = {**self.effect.neutral, **self.shapes, **amplitudes}
        return Placed(self.effect, self.site, own, self.sizes, self.ranges)


@dataclass(frozen=True)
class Columns:
    """Whitened columns of a smoothed recording; the first is the data's, then its p parameters', then candidates'.

    innovations: (N, ny, 1 + p + c), sensitivities with their sign so that data = columns @ values. forces: (N, nv,
    1 + p + c), the posterior missing force of each in the same sense. owners: (candidate, amplitude) of each of the c
    columns, which are in units of the prior's sd.
    """

    innovations: np.ndarray
    forces: np.ndarray
    candidates: tuple[Candidate, ...]
    owners: tuple[tuple[int, int], ...]

    def of(self, candidate: int) -> list[int]:
        """Columns, counted from the first candidate's, of one candidate."""
        return [i for i, (owner, _) in enumerate(self.owners) if owner == candidate]


def candidates(effects: Sequence[Effect], track: Track, scales: Scales) -> list[Candidate]:
    """Every effect at every site with every choice of its shapes."""
    model, channels = track.model, track.recording.channels
    return [
        own for effect in effects for site in effect.sites(model, channels) for own in at(effect, site, model, scales)
    ]


def at(effect: Effect, site: str, model: mujoco.MjModel, scales: Scales) -> list[Candidate]:
    """One effect at one site, with every choice of its shapes."""
    probes, ranges = effect.probes(scales, model, site), effect.ranges(scales, model, site)
    if not probes:
        return []
    sizes = {c.name: max(abs(p[c.name]) for p in probes) for c in effect.coefficients}
    prior = effect.prior(scales, model, site)
    moving = [c for c in effect.coefficients if not c.shape and (sizes[c.name] > 0 or not effect.linear)]
    shapes = [{c.name: p[c.name] for c in effect.coefficients if c.shape} for p in probes]
    if not effect.linear:
        shapes = [{c.name: p[c.name] for c in effect.coefficients} for p in probes]
    found = []
    for own in (s for i, s in enumerate(shapes) if s not in shapes[:i]):
        names = tuple(c.name for c in moving)
        sd = tuple(float(prior.get(c.name) or sizes[c.name] or 1.0) for c in moving)
        positive = tuple(c.low >= effect.neutral[c.name] for c in moving)
        if not effect.linear:  # one column: so many times the effect at this choice of all its values
            names, sd, positive = names[:1], (1.0,), (True,)
        found.append(Candidate(effect, site, own, names, sd, positive, sizes, ranges))
    return found


def columns(smoothed: Smoothed, tried: Sequence[Candidate]) -> Columns:
    """Whitened columns of everything that is tried; what changes nothing, or diverges, is left out."""
    made = _Maker(smoothed)
    offsets, left, pulls, owners = [], [], [], []
    for index, candidate in enumerate(tried):
        for amplitude in range(len(candidate.names)):
            change = made(candidate, amplitude)
            if all(np.isfinite(part).all() for part in change) and any(np.any(part) for part in change):
                for kept, part in zip((offsets, left, pulls), change, strict=True):
                    kept.append(part)
                owners.append((index, amplitude))
    return _swept(smoothed, offsets, left, pulls, tuple(tried), tuple(owners))


def _swept(smoothed: Smoothed, offsets, left, pulls, tried, owners) -> Columns:
    track, linear = smoothed.track, smoothed.linear
    p = linear.left.shape[2]
    whole = replace(
        linear,
        offsets=np.concatenate([linear.offsets, linear.rubbed @ np.stack(offsets, 2)], 2)
        if offsets
        else linear.offsets,
        left=np.concatenate([linear.left, -np.stack(left, 2)], 2) if left else linear.left,
    )
    means = np.zeros((track.count, track.model.nv, p + len(owners)))
    means[:, :, 0] = -smoothed.tau
    for i, pull in enumerate(pulls):
        means[:, :, p + i] = pull
    innovations, _ = swept(track, whole, smoothed.filter, means)
    adjoint, _ = smoothed.filter.adjoint(track, whole, innovations)
    forces = -(smoothed.levels.forces**2)[:, :, None] * adjoint[:, track.space.size :]
    sign = np.ones(innovations.shape[2])
    sign[1:] = -1.0
    return Columns(innovations * sign, forces * sign, tried, owners)


class _Maker:
    """What a unit of the prior of an amplitude does: to the next state (N, n), to the readings (N, ny), as a force
    (N, nv)."""

    def __init__(self, smoothed: Smoothed):
        self.smoothed, self.track, self.plant = smoothed, smoothed.track, smoothed.linear.plant.plain
        self.base = self.plant.step(smoothed.states, smoothed.tau)
        self.told = predicted_commands(self.track, self.plant.ctrl, smoothed.tau)
        self.doubt = smoothed.doubt
        self._again: tuple = (None, None)

    def __call__(self, candidate: Candidate, amplitude: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of one amplitude of `candidate`, or of all of an effect that is not linear."""
        linear = candidate.effect.linear
        share = SMALL if linear else 1.0
        values = np.zeros(len(candidate.names))
        values[amplitude] = share * candidate.sd[amplitude]
        placed = candidate.placed(values)
        make = {"model": self._model, "command": self._command, "measurement": self._measurement}
        return tuple(part / share for part in make.get(candidate.effect.enters, self._force)(placed))

    def _nothing(self) -> list[np.ndarray]:
        track = self.track
        return [
            np.zeros((track.count, size)) for size in (track.space.size, len(track.recording.channels), track.model.nv)
        ]

    def _steps(self, plant, base) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        found = plant.step(self.smoothed.states, self.smoothed.tau * heavier(plant.model, self.plant.model))
        return self.track.space.minus(found.after, base.after), found.readings - base.readings, self._nothing()[2]

    def _model(self, placed: Placed):
        before = self.plant.model
        after = copy.copy(before)
        placed.effect.law(after, placed.site, **placed.values)
        rubbed = after.dof_frictionloss - before.dof_frictionloss
        for name in DRY:
            getattr(after, name)[:] = getattr(before, name)
        change = self._nothing()
        if self._exceeded(before, after):
            return change
        if not _alike(before, after):
            mujoco.mj_setConst(after, mujoco.MjData(after))
            scaled = not np.array_equal(before.actuator_gainprm, after.actuator_gainprm)
            plant = replace(self.plant, models=(after,), ctrl=self.told if scaled else self.plant.ctrl)
            change = list(self._steps(plant, self._predicted() if scaled else self.base))
        if rubbed.any():
            sign = expected_sign(middle(self.track, self.smoothed.states)[1], self._speed_doubt())
            change[2] = change[2] - rubbed * sign
        return change

    def _exceeded(self, before: mujoco.MjModel, after: mujoco.MjModel) -> bool:
        """Whether the motion needed more of a motor than a limit would let it give."""
        limited = np.flatnonzero((before.actuator_forcerange != after.actuator_forcerange).any(1))
        return any(self._needed(m) > 1.1 * np.abs(after.actuator_forcerange[m]).max() for m in limited)

    def _needed(self, motor: int) -> float:
        model, states = self.plant.model, self.smoothed.states
        if model.actuator_trntype[motor] != ON_JOINT:
            return 0.0
        joint = model.actuator_trnid[motor, 0]
        dof, gear = model.jnt_dofadr[joint], model.actuator_gear[motor, 0]
        gain, bias = model.actuator_gainprm[motor], model.actuator_biasprm[motor]
        length, speed = gear * states.qpos[:, model.jnt_qposadr[joint]], gear * states.qvel[:, dof]
        given = gain[0] * self.plant.ctrl[:, 0, motor] + bias[0] + bias[1] * length + bias[2] * speed
        if model.actuator_forcelimited[motor]:
            given = np.clip(given, *model.actuator_forcerange[motor])
        return float(np.quantile(np.abs(given + self.smoothed.tau[:, dof] / gear), 0.99))

    def _predicted(self):
        if self._again[0] is None:
            plant = replace(self.plant, ctrl=self.told)
            self._again = plant, plant.step(self.smoothed.states, self.smoothed.tau)
        return self._again[1]

    def _speed_doubt(self) -> np.ndarray:
        return speed_doubt(self.track, self.smoothed.states, self.doubt)

    def _force(self, placed: Placed):
        change, states, tau = self._nothing(), self.smoothed.states, self.smoothed.tau
        change[2] = force_of(self.track, placed, states, tau, self.doubt)
        if placed.effect.enters == "gear":
            none = replace(placed, values=placed.effect.neutral)
            change[2] = change[2] - force_of(self.track, none, states, tau, self.doubt)
            readings = [reading_of(self.track, law, states, tau, self.base.readings) for law in (placed, none)]
            change[1] = readings[0] - readings[1]
        return change

    def _command(self, placed: Placed):
        plant = replace(self.plant, ctrl=self.track.commands((*self.plant.placed, placed)))
        return self._steps(plant, self.base)

    def _measurement(self, placed: Placed):
        change = self._nothing()
        change[1] = reading_of(self.track, placed, self.smoothed.states, self.smoothed.tau, self.base.readings)
        change[1] = change[1] - self.base.readings
        return change


def _alike(before: mujoco.MjModel, after: mujoco.MjModel) -> bool:
    if not np.array_equal(before.opt.gravity, after.opt.gravity):
        return False
    return all(np.array_equal(getattr(before, name), getattr(after, name)) for name in EDITED)


# Arrays of a model that laws edit.
EDITED = tuple(
    "body_mass body_inertia body_ipos body_iquat body_gravcomp dof_damping dof_dampingpoly dof_armature jnt_stiffness "
    "jnt_stiffnesspoly qpos_spring actuator_gainprm actuator_biasprm actuator_biastype actuator_forcerange "
    "actuator_forcelimited actuator_dynprm geom_pos geom_quat geom_size geom_friction geom_solref geom_condim "
    "pair_friction pair_solref pair_dim pair_margin".split()
)


def motion_scales(smoothed: Smoothed) -> Scales:
    """Typical magnitudes of the smoothed motion, from which probes and priors follow."""
    track, states, model = smoothed.track, smoothed.states, smoothed.track.model
    force, given = _loads(track, smoothed.linear.plant.model, states, smoothed.tau)
    place = _position_of_dof(model)
    moving = model.body_mass[model.body_weldid > 0]
    measured = np.array([_spread(column) for column in track.measured.T])
    gravity = float(np.linalg.norm(model.opt.gravity))
    return Scales(
        force=_rms(force), speed=_rms(states.qvel), travel=states.qpos.std(0)[place], middle=states.qpos.mean(0)[place],
        drive=_rms(given), summit=np.abs(given).max(0, initial=0.0), measured=measured, mass=float(moving.sum()),
        length=float(model.stat.extent), gravity=gravity or 9.81, period=track.period,
        duration=float(track.lengths.max()) * track.period,
    )  # fmt: skip


def _loads(track: Track, model: mujoco.MjModel, states: States, tau) -> tuple[np.ndarray, np.ndarray]:
    """Generalised force that the motion needs, or that motors give, (N, nv), and force of each motor, (N, nu)."""
    data = mujoco.MjData(model)
    needed, given = np.zeros_like(states.qvel), np.zeros((len(states), model.nu))
    for k in range(0, len(states), max(1, len(states) // 2000)):
        data.qpos[:], data.qvel[:], data.act[:], data.ctrl[:] = (
            states.qpos[k], states.qvel[k], states.act[k], track.ctrl[k, 0],
        )  # fmt: skip
        mujoco.mj_forward(model, data)
        needed[k] = data.qfrc_actuator if model.nu else data.qfrc_bias
        given[k] = data.actuator_force
        blind = needed[k] == 0
        needed[k][blind] = (data.qfrc_bias + tau[k])[blind]
    rows = slice(0, len(states), max(1, len(states) // 2000))
    return needed[rows], given[rows]


def _rms(rows: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.mean(rows**2, 0), np.finfo(float).tiny))


def _spread(column: np.ndarray) -> float:
    known = column[np.isfinite(column)]
    return float(known.std()) if known.size else 0.0


def _position_of_dof(model: mujoco.MjModel) -> np.ndarray:
    # A rotation's scale is that of its quaternion's vector part.
    place = np.empty(model.nv, int)
    for joint in range(model.njnt):
        width = {0: 6, 1: 3}.get(int(model.jnt_type[joint]), 1)
        extra = np.arange(width) + (np.arange(width) >= 3 if width == 6 else width == 3)
        first = model.jnt_dofadr[joint]
        place[first : first + width] = model.jnt_qposadr[joint] + extra
    return place
