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
from fimpact.simulation.nonsmooth import stop_within_a_step
from fimpact.smoothing.filtering import swept
from fimpact.smoothing.inverse import edits
from fimpact.smoothing.laws import DRY, acts_of, expected_sign, middle, predicted_commands, reading_of, speed_doubt
from fimpact.smoothing.response import Change, Response
from fimpact.smoothing.simulated import Simulated
from fimpact.smoothing.smoother import Smoothed
from fimpact.smoothing.states import States
from fimpact.smoothing.track import Plant, Track

ACTING = ("force", "friction", "gear")  # ways in which laws act along a motion, without a simulation
SMALL = 1e-2  # share of its prior at which a linear effect is tried: in contact no tangent holds for all of it


@dataclass(frozen=True)
class Candidate:
    """An effect at a site with one choice of its shapes. names: its amplitudes; sd, positive: of each, prior standard
    deviation and whether physics forbids less than nothing. sizes, ranges: of its values (`Placed`).
    priors: sd of its amplitudes in their own units."""

    effect: Effect
    site: str
    shapes: dict[str, float]
    names: tuple[str, ...]
    sd: tuple[float, ...]
    positive: tuple[bool, ...]
    sizes: dict[str, float]
    ranges: dict[str, tuple[float, float]]
    priors: dict[str, float]

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
        positive = tuple(ranges.get(c.name, (c.low, c.high))[0] >= effect.neutral[c.name] for c in moving)
        priors = dict(zip(names, sd, strict=True))
        if not effect.linear:  # one column: so many times the effect at this choice of all its values
            names, sd, positive = names[:1], (1.0,), (True,)
        found.append(Candidate(effect, site, own, names, sd, positive, sizes, ranges, priors))
    return found


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
    made, track = _Maker(smoothed), smoothed.track
    acting = [i for i, law in enumerate(laws) if law.effect.enters in ACTING]
    acts = acts_of(track, [laws[i] for i in acting], smoothed.states, smoothed.tau, smoothed.doubt)
    found = {
        i: replace(made.response.nothing(), force=force, readings=readings)
        for i, (force, readings) in zip(acting, acts, strict=True)
    }
    if known is None or not track.long:
        return [found[i] if i in found else made(law) for i, law in enumerate(laws)]
    known.along(smoothed)
    simulated = [law.effect.enters in ("model", "command") for law in laws]
    for i in [i for i in range(len(laws)) if i not in found]:
        found[i] = known.change(laws[i], made, made.rough) if simulated[i] else made(laws[i])
    return [found[i] for i in range(len(laws))]


def _swept(smoothed: Smoothed, changes: Sequence[Change], tried, owners) -> Columns:
    track, linear = smoothed.track, smoothed.linear
    p = linear.left.shape[2]
    whole, means = linear, np.zeros((track.count, track.model.nv, p + len(owners)))
    if changes:
        after = linear.rubbed @ np.stack([c.after for c in changes], 2)
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
    forces = -(smoothed.levels.forces**2)[:, :, None] * adjoint[:, track.space.size :]
    sign = np.ones(innovations.shape[2])
    sign[1:] = -1.0
    return Columns(innovations * sign, forces * sign, tried, owners)


class _Maker:
    """What edits of the model, of commands and of readings do beside the plant of a smoothed recording."""

    _coarse: "_Maker | None" = None

    def __init__(self, smoothed: Smoothed):
        self.smoothed, self.track = smoothed, smoothed.track
        # The trajectory of the last derivatives is as good as the last one for what they decide.
        self.response = self._response(smoothed.linear.plant)
        self.plant = self.response.plant
        given = self.plant.ctrl
        self.told = replace(given, values=predicted_commands(self.track, given.values, smoothed.tau))

    def _response(self, plant: Plant) -> Response:
        smoothed = self.smoothed
        return Response(plant, smoothed.states, smoothed.tau, smoothed.linear.response.inverse)

    def rough(self, placed: Placed) -> Change:
        """Of one effect, at the model's own time step."""
        if self._coarse is None:
            self._coarse = copy.copy(self)
            self._coarse.response = self._response(self.smoothed.linear.plant.coarse)
            self._coarse.plant = self._coarse.response.plant
        return self._coarse(placed)

    def __call__(self, placed: Placed) -> Change:
        """Of one effect."""
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
        return any(self._needed(m) > 1.1 * np.abs(after.actuator_forcerange[m]).max() for m in limited)

    def _needed(self, motor: int) -> float:
        model, states = self.plant.model, self.smoothed.states
        if model.actuator_trntype[motor] != ON_JOINT:
            return 0.0
        joint = model.actuator_trnid[motor, 0]
        dof, gear = model.jnt_dofadr[joint], model.actuator_gear[motor, 0]
        gain, bias = model.actuator_gainprm[motor], model.actuator_biasprm[motor]
        length, speed = gear * states.qpos[:, model.jnt_qposadr[joint]], gear * states.qvel[:, dof]
        given = gain[0] * self.plant.ctrl.values[:, 0, motor] + bias[0] + bias[1] * length + bias[2] * speed
        if model.actuator_forcelimited[motor]:
            given = np.clip(given, *model.actuator_forcerange[motor])
        return float(np.quantile(np.abs(given + self.smoothed.tau[:, dof] / gear), 0.99))

    def _measurement(self, placed: Placed) -> Change:
        base = self.smoothed.linear.base.readings
        read = reading_of(self.track, placed, self.smoothed.states, base, self.smoothed.surprise)
        return replace(self.response.nothing(), readings=read - base)


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
