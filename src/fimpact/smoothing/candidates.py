"""Every effect at every place with its choices of shapes, and the typical magnitudes that they follow from."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from fimpact.effects.base import Effect, Placed, Scales
from fimpact.effects.wiring import ON_JOINT
from fimpact.smoothing.dynamics.laws import middle
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States


@dataclass(frozen=True)
class Candidate:
    """An effect at a site with one choice of its shapes. names: its amplitudes; sd, positive: of each, prior standard
    deviation and whether physics forbids less than nothing. sizes, ranges, least: of its values (`Placed`).
    priors: sd of its amplitudes in their own units. among: how many values it is the best of."""

    effect: Effect
    site: str
    shapes: dict[str, float]
    names: tuple[str, ...]
    sd: tuple[float, ...]
    positive: tuple[bool, ...]
    sizes: dict[str, float]
    ranges: dict[str, tuple[float, float]]
    priors: dict[str, float]
    least: dict[str, float] = field(default_factory=dict)
    among: int = 1

    @property
    def name(self) -> str:
        """``effect@site``."""
        return f"{self.effect.name}@{self.site}"

    def placed(self, values: Iterable[float]) -> Placed:
        """The effect with these amplitudes."""
        amplitudes = dict(zip(self.names, map(float, values), strict=True)) if self.effect.linear else {}
        return self.placed_as({**self.effect.neutral, **self.shapes, **amplitudes})

    def placed_as(self, values: dict[str, float]) -> Placed:
        """The effect with all its values."""
        return Placed(self.effect, self.site, values, self.sizes, self.ranges, self.least)


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
    prior, least = effect.prior(scales, model, site), effect.least(scales, model, site)
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
        found.append(Candidate(effect, site, own, names, sd, positive, sizes, ranges, priors, least))
    return found


def scales_along(
    track: Track, model: mujoco.MjModel, states: States, tau: np.ndarray, told: np.ndarray | None = None
) -> Scales:
    """The same of any states, (N,), of a track under `model` with the missing force `tau`, (N, nv).

    Args:
        told: commands that reach the motors, (N, nu); default: the recorded ones.
    """
    force, given = _loads(track, model, states, tau)
    needed = needed_of_motors(track, model, track.ctrl[:, 0] if told is None else told, states, tau)
    place = _position_of_dof(model)
    moving = model.body_mass[model.body_weldid > 0]
    measured = np.array([_spread(column) for column in track.measured.T])
    gravity = float(np.linalg.norm(model.opt.gravity))
    return Scales(
        force=_rms(force), speed=_rms(states.qvel), travel=states.qpos.std(0)[place], middle=states.qpos.mean(0)[place],
        drive=_rms(given), summit=np.abs(given).max(0, initial=0.0), needed=needed, measured=measured,
        mass=float(moving.sum()), length=float(model.stat.extent), gravity=gravity or 9.81, period=track.period,
        duration=float(track.lengths.max()) * track.period,
    )  # fmt: skip


def needed_of_motors(track: Track, model: mujoco.MjModel, told: np.ndarray, states: States, tau: np.ndarray):
    """Force of each motor, (nu,), of which a hundredth of the samples needed more; 0 of one that is on no joint.

    Over whole samples: a servo's short peak, where its target has just jumped, is no need of the motion's.
    """
    qpos, qvel = middle(track, states)
    found = np.zeros(model.nu)
    for motor in np.flatnonzero(model.actuator_trntype == ON_JOINT):
        joint = model.actuator_trnid[motor, 0]
        dof, gear = model.jnt_dofadr[joint], model.actuator_gear[motor, 0]
        gain, bias = model.actuator_gainprm[motor], model.actuator_biasprm[motor]
        length, speed = gear * qpos[:, model.jnt_qposadr[joint]], gear * qvel[:, dof]
        given = gain[0] * told[:, motor] + bias[0] + bias[1] * length + bias[2] * speed
        if model.actuator_forcelimited[motor]:
            given = np.clip(given, *model.actuator_forcerange[motor])
        found[motor] = np.quantile(np.abs(given + tau[:, dof] / gear), 0.99) if gear else 0.0
    return found


def _loads(track: Track, model: mujoco.MjModel, states: States, tau) -> tuple[np.ndarray, np.ndarray]:
    """Generalised force that the motion needs, or that motors give, (N, nv), and force of each motor, (N, nu)."""
    data = mujoco.MjData(model)
    needed, given = np.zeros_like(states.qvel), np.zeros((len(states), model.nu))
    for k in range(0, len(states), max(1, len(states) // 2000)):
        data.qpos[:], data.qvel[:], data.act[:], data.ctrl[:] = (
            states.qpos[k], states.qvel[k], states.act[k, : model.na], track.ctrl[k, 0],
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
