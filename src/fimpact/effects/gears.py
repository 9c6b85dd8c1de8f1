"""Gears that give: the rotor has a motion of its own behind them, which an encoder on the motor's side sees.

What the joint's coordinate moves is the link. A rotor that turns ahead of it by the lead d obeys
I (d'' + a) = τ_motor − τ_gear, with a the link's acceleration, and is carried through each time step exactly, a taken
as constant. As a is not known before the step, the gear is given to it as a force and as an inertia in the place of
the joint's armature: what of the rotor the link feels within one step. A servo looks where its motor is and not where
the link is: on the rotor it is a further spring and damper.
"""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.effects.drives import ahead_of, is_servo, motor_force
from fimpact.effects.law_inputs import State

PARTS = 4  # of a step, in each of which a rotor is either loose or at one end of its play


@dataclass(frozen=True)
class Shaft:
    """A motor and the link behind its gear in n simulations at the start of one step.

    torque (n,): the motor's over the step, N m or N. speed (n,): the link's. rotor: inertia on the motor's side, the
    joint's `armature`, kg m^2 or kg, one for all or (n,). step: s. memory: what a gear law keeps, empty at the start of
    a window. servo: of (lead, rate), (n,) each, what the motor gives where it is (`drives.Ahead`); None: `torque`.
    """

    torque: np.ndarray
    speed: np.ndarray
    rotor: np.ndarray | float
    step: float
    memory: dict
    servo: Callable | None = None

    def motor(self, lead: np.ndarray, rate: np.ndarray) -> "Servo":
        """The motor's force around a lead and its rate."""
        none = np.zeros_like(self.torque)
        if self.servo is None:
            return Servo(self.torque, none, none)
        here, stiffness, damping = self.servo(lead, rate)
        return Servo(here + stiffness * lead + damping * rate, stiffness, damping)


@dataclass(frozen=True)
class Servo:
    """A motor's force at lead d, base − stiffness d − damping ḋ, (n,) each."""

    base: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray

    def at(self, lead: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Its force there."""
        return self.base - self.stiffness * lead - self.damping * rate


@dataclass(frozen=True)
class Coupling:
    """What a gear does, (n,) each: pull: force on the joint beside the motor's, mean over the step; inertia: what the
    link feels in the place of the armature; at_once: the same two at the very start of the step; lead, rate: how
    far and how fast the encoder is ahead of the link there."""

    pull: np.ndarray
    inertia: np.ndarray
    at_once: tuple[np.ndarray, np.ndarray]
    lead: np.ndarray
    rate: np.ndarray


def coupled(model: mujoco.MjModel, state: State, law, site: str, values: dict[str, float]) -> Coupling:
    """What the gear `law` does at joint `site` in the step that begins at `state`."""
    memory = state.memory.setdefault(("gear", site), {})
    dof, _, speed = state.joint(site)
    # As it was at first: while a step lasts, what the link feels stands there.
    rotor = memory.setdefault("rotor", float(model.dof_armature[dof]))
    servo = ahead_of(state, site) if is_servo(state, site) else None
    return law(Shaft(motor_force(state, site), speed, rotor, state.step, memory, servo), site, **values)


def encoders(model: mujoco.MjModel, site: str) -> tuple[list[int], list[int]]:
    """Columns in `sensordata` of what reads the position and the speed of joint `site` on the motor's side."""
    kinds = mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtSensor.mjSENS_JOINTVEL
    here = model.sensor_objid == model.joint(site).id
    return tuple(model.sensor_adr[here & (model.sensor_type == int(kind))].tolist() for kind in kinds)


def elastic(shaft: Shaft, site: str, compliance: float, retardation: float) -> Coupling:
    """A spring, rad/(N m) or m/N, beside a damper of `retardation`, s, times its stiffness (Kelvin-Voigt)."""
    inertia = np.full_like(shaft.torque, shaft.rotor)
    none = np.zeros_like(inertia)
    if _rigid(shaft, compliance):
        return _wound(shaft, compliance, retardation)
    found = _from_previous_step(shaft)
    if found is None:  # until the link's acceleration is known, the spring is wound up by what it must carry
        motor = shaft.motor(none, none)
        give = compliance / (1 + compliance * motor.stiffness)
        rest = give * motor.base
        _store(shaft, np.stack([rest, none]), np.stack([give * inertia, none]))
        beside = motor.at(rest, none) - shaft.torque
        return Coupling(beside, inertia, (beside, inertia), rest, none)
    lead, rate = found
    motor = shaft.motor(lead, rate)
    moved, pushed = _swing_of(shaft, motor, compliance, retardation)
    end = np.stack([row[0] * lead + row[1] * rate for row in moved]) + pushed * (motor.base / shaft.rotor)
    slope = np.broadcast_to(pushed, end.shape)
    _store(shaft, end, slope)
    carried = (lead + retardation * rate) / compliance
    pull, felt = _mean(shaft, motor, found, rate, end, slope)
    return Coupling(pull, felt, (carried - shaft.torque, none), lead, rate)


def _rigid(shaft: Shaft, give: np.ndarray | float) -> bool:
    """Whether nothing swings: no `give`, or no rotor; of laws side by side it is so for all, or for none."""
    return bool(np.any(np.minimum(give, shaft.rotor) <= 0))


def _wound(shaft: Shaft, compliance: float, retardation: float) -> Coupling:
    """A rotor without inertia, or a gear that does not give: what the motor gives is carried at once, and only its
    winding up takes time."""
    none = np.zeros_like(shaft.torque)
    inertia, lead = np.full_like(none, shaft.rotor), shaft.memory.get("lead")
    motor = shaft.motor(none if lead is None else lead, shaft.memory.get("rate", none))
    give = 1 + compliance * motor.stiffness
    rest, time = compliance * motor.base / give, (retardation + compliance * motor.damping) / give
    lead = rest if lead is None else lead
    decayed = np.where(time > 0, np.exp(-shaft.step / np.where(time > 0, time, 1.0)), 0.0)
    end = rest + (lead - rest) * decayed
    shaft.memory["lead"], shaft.memory["rate"] = end, (end - lead) / shaft.step
    rate = shaft.memory["rate"]
    beside = motor.at((lead + end) / 2, rate) - shaft.torque
    return Coupling(beside, inertia, (motor.at(lead, rate) - shaft.torque, inertia), lead, rate)


def loose(shaft: Shaft, site: str, gap: float) -> Coupling:
    """Play: within it the rotor moves freely, at its ends it and the link push each other and do not bounce."""
    none, inertia = np.zeros_like(shaft.torque), np.full_like(shaft.torque, shaft.rotor)
    if _rigid(shaft, gap):
        lead, motor = _rest(shaft, gap)
        beside = motor.at(lead, none) - shaft.torque
        return Coupling(beside, inertia, (beside, inertia), lead, none)
    found = _from_previous_step(shaft)
    if found is None:
        lead, rate = _rest(shaft, gap)[0], none
        side = np.where(np.abs(lead) < gap / 2, 0.0, np.sign(lead))
    else:
        side, (lead, rate) = shaft.memory["side"], found
    last = shaft.memory.get("acceleration", none)
    # The link may have moved otherwise than was reckoned with, and met the rotor.
    side, begun = np.where(np.abs(lead) > gap / 2, np.sign(lead), side), rate
    lead, rate = np.minimum(np.maximum(lead, -gap / 2), gap / 2), np.where(side == 0, rate, 0.0)
    motor = shaft.motor(lead, rate)
    given = motor.at(lead, rate)
    side = np.where(side * (given / shaft.rotor - last) > 0, side, 0.0)
    free = side == 0
    at_once = np.where(free, 0.0, given) - shaft.torque, np.where(free, 0.0, shaft.rotor)
    begins = np.stack([lead, rate])
    end, slope, shaft.memory["side"] = _advance(shaft, motor, begins, side, last, gap)
    _store(shaft, end, slope)
    pull, felt = _mean(shaft, motor, begins, begun, end, slope)
    return Coupling(pull, felt, at_once, lead, rate)


def _rest(shaft: Shaft, gap: float) -> tuple[np.ndarray, Servo]:
    """Where in its play a rotor is that nothing has moved yet, or that has no inertia: where a servo wants it, or at
    the end to which the motor pushes."""
    none = np.zeros_like(shaft.torque)
    motor = shaft.motor(none, none)
    wanted = motor.base / np.where(motor.stiffness > 0, motor.stiffness, 1.0)
    return np.where(motor.stiffness > 0, np.clip(wanted, -gap / 2, gap / 2), np.sign(motor.base) * gap / 2), motor


def _advance(shaft: Shaft, motor: Servo, end: np.ndarray, held: np.ndarray, last: np.ndarray, gap: float):
    """Lead and rate after the step where the link does not accelerate, (2, n), what they lose for each unit of its
    acceleration, (2, n), and the end of the play at which the rotor then is, 0 for none."""
    part, drive, (lead, rate) = shaft.step / PARTS, motor.base / shaft.rotor, end
    spring, slowed = motor.stiffness / shaft.rotor, part * motor.damping / shaft.rotor / 2
    # The trapezium rule, which is exact where no servo pulls.
    slowed = slowed + part**2 * spring / 4
    twice, whole, half = 2 * slowed, 1 + slowed, gap / 2
    less, slower = np.zeros_like(end)
    for _ in range(PARTS):
        free = held == 0
        gain = (part * (drive - spring * lead) - twice * rate) / whole
        loss = (part * (1 - spring * less) - twice * slower) / whole
        moving = free * part
        lead, less = lead + moving * (rate + gain / 2), less + moving * (slower + loss / 2)
        rate, slower = rate + free * gain, slower + free * loss
        place = lead - less * last
        met = free & (np.abs(place) >= half)
        held = np.where(met, np.sign(place), held)
        lead = np.where(met, held * half, lead)
        less, rate, slower = (np.where(met, 0.0, own) for own in (less, rate, slower))
        held = np.where(held * (drive - spring * lead - last) > 0, held, 0.0)
    return np.stack([lead, rate]), np.stack([less, slower]), held


def _from_previous_step(shaft: Shaft) -> np.ndarray | None:
    """Lead and rate now, (2, n), from what the step before left and how the link moved in it; None at first."""
    memory, end = shaft.memory, None
    if "end" in memory:
        memory["acceleration"] = (shaft.speed - memory["speed"]) / shaft.step
        end = memory["end"] - memory["slope"] * memory["acceleration"]
    memory["speed"] = shaft.speed
    return end


def _store(shaft: Shaft, end: np.ndarray, slope: np.ndarray) -> None:
    shaft.memory["end"], shaft.memory["slope"] = end, slope


def _mean(shaft: Shaft, motor: Servo, begins, rate, end, slope) -> tuple[np.ndarray, np.ndarray]:
    """Force beside the motor's and inertia in the place of the armature: the rotor's own momentum is the rest.

    Args:
        begins, end, slope: lead and rate, (2, n), at the start and, where the link does not accelerate, at the end of
            the step, and what they lose at the end for each unit of its acceleration.
        rate: at the start, before a blow.
    """
    share = shaft.rotor / shaft.step
    mean = motor.at((begins[0] + end[0]) / 2, (end[0] - begins[0]) / shaft.step)
    eased = (motor.stiffness / 2 + motor.damping / shaft.step) * slope[0]
    return mean - shaft.torque - share * (end[1] - rate), shaft.rotor - share * slope[1] - eased


def _swing_of(shaft: Shaft, motor: Servo, compliance: float, retardation: float) -> tuple[np.ndarray, np.ndarray]:
    """The oscillator step of the gear and the servo together: the same from step to step as long as the servo is."""
    if "swing" in shaft.memory:
        found, held, damped = shaft.memory["swing"]
        if shaft.servo is None or (np.array_equal(held, motor.stiffness) and np.array_equal(damped, motor.damping)):
            return found
    stiffness = 1 / compliance + motor.stiffness
    retarded = (retardation / compliance + motor.damping) / stiffness
    found = _damped_oscillator_step(stiffness / shaft.rotor, retarded, shaft.step)
    shaft.memory["swing"] = found, motor.stiffness, motor.damping
    return found


def _damped_oscillator_step(square: np.ndarray, retardation: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact step of d'' = −square (d + retardation d') + u, (n,) each: of the state, (2, 2, n), and of u, (2, n)."""
    half = retardation * square / 2
    fast = -half - np.sqrt(half**2 - square * (1 + 1e-12j))
    slow = square / fast
    decayed = np.exp(slow * step), np.exp(fast * step)
    cross = ((decayed[0] - decayed[1]) / (slow - fast)).real
    stay = ((slow * decayed[1] - fast * decayed[0]) / (slow - fast)).real
    after = ((slow * decayed[0] - fast * decayed[1]) / (slow - fast)).real
    return np.array([[stay, cross], [-square * cross, after]]), np.array([(1 - stay) / square, cross])
