"""What the actuators of a joint deliver."""

from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.effects.law_inputs import HELD, MOTORS, State
from fimpact.effects.sites import driven
from fimpact.effects.wiring import drives


@dataclass(frozen=True)
class Drive:
    """An actuator, by its index: gear ratio, gain and bias, (3,) each of 1, length and speed or a constant, limits of
    its force (low, high) and of its command (least, most)."""

    index: int
    gear: float
    gain: np.ndarray | float
    bias: np.ndarray | float
    low: float
    high: float
    least: float
    most: float


@dataclass(frozen=True)
class Motor:
    """All that drives a joint: its actuators, whether they hold the gravity of bodies (actuatorgravcomp), the limits of
    what they give together (actuatorfrcrange), and whether that depends on where they are."""

    actuators: list[Drive]
    holds: bool
    low: float
    high: float
    servo: bool


@dataclass(frozen=True)
class Ahead:
    """Forces of a motor that runs ahead of its joint, in n states.

    force (d, n): of each of d actuators before its limits where it is not ahead; slopes (2, d, n): what that changes
    for each unit of its lead and of the rate of it. gear, low, high: of each, (d, 1) or (d, n). held (n,): what they
    give besides, against gravity. least, most: limits of all together, one for all states or (n,).
    """

    force: np.ndarray
    slopes: np.ndarray
    gear: np.ndarray
    low: np.ndarray
    high: np.ndarray
    held: np.ndarray
    least: np.ndarray | float
    most: np.ndarray | float

    def __call__(self, lead: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, ...]:
        """The force at these leads and rates, and by how much less it is for each unit more of either, (n,) each."""
        force = self.force + self.slopes[0] * lead + self.slopes[1] * rate
        kept = within(force, self.low, self.high)
        total = (self.gear * kept).sum(0) + self.held
        given = within(total, self.least, self.most)
        free = self.gear * (kept == force)
        less = ((given == total) * -(free * own).sum(0) for own in self.slopes)
        return given, *(np.maximum(own, 0.0) for own in less)


def motor_force(state: State, site: str) -> np.ndarray:
    """Force, (n,), of the actuators on joint `site` as they leave the gear, N or N m."""
    motor, (_, position, speed) = _motor(state, site), state.joint(site)
    total = np.zeros(len(position))
    for drive, _, force in _each(state, motor, position, speed):
        total += drive.gear * within(force, drive.low, drive.high)
    return within(total + _holding(state, motor, site), motor.low, motor.high)


def is_servo(state: State, site: str) -> bool:
    """Whether the force of a motor on joint `site` depends on where it is or how fast it turns, as a servo's does."""
    return _motor(state, site).servo


def servo_force(state: State, site: str, lead: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, ...]:
    """The force where the motor is ahead of joint `site` by `lead` (n,), rad or m, and runs away from it at `rate`
    (n,), and by how much less it is for each unit more of the one and of the other, (n,) each."""
    return ahead_of(state, site)(lead, rate)


def ahead_of(state: State, site: str) -> Ahead:
    """What the motor of joint `site` gives in each of these states where it is not where the joint is."""
    motor, (_, position, speed) = _motor(state, site), state.joint(site)
    size, acting = (len(motor.actuators), len(position)), motor.actuators
    force, slopes = np.empty(size), np.empty((2, *size))
    for row, (drive, command, own) in enumerate(_each(state, motor, position, speed)):
        force[row] = own
        both = np.multiply.outer(_three(drive.gain)[1:], command) + _three(drive.bias)[1:, None]
        slopes[:, row] = drive.gear * both
    names = ("gear", "low", "high")
    gear, low, high = (np.array([getattr(own, name) for own in acting]).reshape(-1, 1) for name in names)
    held = np.broadcast_to(_holding(state, motor, site), position.shape)
    return Ahead(force, slopes, gear, low, high, held, motor.low, motor.high)


def driven_joints(state: State) -> list[str]:
    """Joints that motors drive."""
    known = state.memory.setdefault(MOTORS, {})
    if "" not in known:
        known[""] = driven(state.model)
    return known[""]


def position_servo(state: State, site: str) -> tuple[str, Drive]:
    """The joint that actuator `site` drives, and what it is."""
    known = state.memory.setdefault(MOTORS, {})
    if ("servo", site) not in known:
        row = state.model.actuator(site)
        known["servo", site] = state.model.joint(row.trnid[0]).name, _drive(state.model, row.id)
    return known["servo", site]


def within(values: np.ndarray, low: np.ndarray | float, high: np.ndarray | float) -> np.ndarray:
    """Clip `values`, as np.clip does, which takes three times as long."""
    return np.minimum(np.maximum(values, low), high)


def _each(state: State, motor: Motor, position: np.ndarray, speed: np.ndarray):
    """Each actuator with its command and its force before limits, (n,) each."""
    for drive in motor.actuators:
        command = within(state.ctrl[:, drive.index], drive.least, drive.most)
        force = _at(drive.gain, drive, position, speed) * command
        yield drive, command, force + _at(drive.bias, drive, position, speed)


def _holding(state: State, motor: Motor, site: str) -> np.ndarray | float:
    return _held(state)[:, state.joint(site)[0]] if motor.holds else 0.0


def _three(factor: np.ndarray | float) -> np.ndarray:
    return np.array([factor, 0.0, 0.0]) if isinstance(factor, float) else factor


def _at(factor: np.ndarray | float, drive: Drive, position: np.ndarray, speed: np.ndarray) -> np.ndarray | float:
    if isinstance(factor, float):
        return factor
    return factor @ np.stack([np.ones_like(speed), drive.gear * position, drive.gear * speed])


def _held(state: State) -> np.ndarray:
    """Generalised forces, (n, nv), that hold bodies against gravity (gravcomp)."""
    if HELD not in state.memory:  # making it takes longer than all that follows
        state.memory[HELD] = mujoco.MjData(state.model)
    data, out = state.memory[HELD], np.empty((len(state.qpos), state.model.nv))
    for row, qpos in enumerate(state.qpos):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(state.model, data)
        mujoco.mj_comPos(state.model, data)
        mujoco.mj_passive(state.model, data)
        out[row] = data.qfrc_gravcomp
    return out


def _motor(state: State, site: str) -> Motor:
    # Asking a model takes longer than all that follows, and no law changes its actuators.
    known = state.memory.setdefault(MOTORS, {})
    if site not in known:
        known[site] = _asked(state.model, site)
    return known[site]


def _asked(model: mujoco.MjModel, site: str) -> Motor:
    joint = model.joint(site).id
    if not model.nu or model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION:
        return Motor([], False, -np.inf, np.inf, False)
    low, high = model.jnt_actfrcrange[joint] if model.jnt_actfrclimited[joint] else (-np.inf, np.inf)
    acting = [_drive(model, i) for i in drives(model, site) if not _off(model, i)]
    own = any(np.any(np.atleast_1d(factor)[1:]) for drive in acting for factor in (drive.gain, drive.bias))
    return Motor(acting, bool(model.jnt_actgravcomp[joint]), float(low), float(high), own)


def _off(model: mujoco.MjModel, i: int) -> bool:
    group = int(model.actuator_group[i])
    return 0 <= group <= 30 and bool(model.opt.disableactuator >> group & 1)


def _drive(model: mujoco.MjModel, i: int) -> Drive:
    gain, bias = model.actuator_gainprm[i, :3].copy(), model.actuator_biasprm[i, :3].copy()
    low, high = model.actuator_forcerange[i] if model.actuator_forcelimited[i] else (-np.inf, np.inf)
    clamped = model.actuator_ctrllimited[i] and not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    least, most = model.actuator_ctrlrange[i] if clamped else (-np.inf, np.inf)
    return Drive(
        i,
        float(model.actuator_gear[i, 0]),
        gain if model.actuator_gaintype[i] else float(gain[0]),
        bias if model.actuator_biastype[i] else 0.0,
        float(low),
        float(high),
        float(least),
        float(most),
    )
