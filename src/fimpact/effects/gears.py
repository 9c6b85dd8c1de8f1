"""Gears that give: the rotor has a motion of its own behind them, which an encoder on the motor's side sees.

What the joint's coordinate moves is the link. A rotor that turns ahead of it by the lead d obeys
I (d'' + a) = τ_motor − τ_gear, with a the link's acceleration, and is carried through each time step exactly, a taken
as constant. As a is not known before the step, the gear is given to it as a force and as an inertia in the place of
the joint's armature: what of the rotor the link feels within one step.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.effects.base import State
from fimpact.effects.drives import motor_force

PARTS = 4  # of a step, in each of which a rotor is either loose or at one end of its play


@dataclass(frozen=True)
class Shaft:
    """A motor and the link behind its gear in n simulations at the start of one step.

    torque (n,): the motor's over the step, N m or N. speed (n,): the link's. rotor: inertia on the motor's side, the
    joint's `armature`, kg m^2 or kg. step: s. memory: what a gear law keeps, empty at the start of a window.
    """

    torque: np.ndarray
    speed: np.ndarray
    rotor: float
    step: float
    memory: dict


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
    shaft = Shaft(motor_force(state, site), speed, rotor, state.step, memory)
    return law(shaft, site, **values)


def encoders(model: mujoco.MjModel, site: str) -> tuple[list[int], list[int]]:
    """Columns in `sensordata` of what reads the position and the speed of joint `site` on the motor's side."""
    kinds = mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtSensor.mjSENS_JOINTVEL
    here = model.sensor_objid == model.joint(site).id
    return tuple(model.sensor_adr[here & (model.sensor_type == int(kind))].tolist() for kind in kinds)


def elastic(shaft: Shaft, site: str, compliance: float, retardation: float) -> Coupling:
    """A spring, rad/(N m) or m/N, beside a damper of `retardation`, s, times its stiffness (Kelvin-Voigt)."""
    inertia = np.full_like(shaft.torque, shaft.rotor)
    rigid = np.zeros_like(inertia), inertia
    if compliance <= 0 or shaft.rotor <= 0:
        return Coupling(*rigid, rigid, *_wound(shaft, compliance, retardation))
    if "swing" not in shaft.memory:
        shaft.memory["swing"] = _swing(1 / (compliance * shaft.rotor), retardation, shaft.step)
    moved, pushed = shaft.memory["swing"]
    found = _arrived(shaft)
    if found is None:  # until the link's acceleration is known, the spring is wound up by what it must carry
        rest = compliance * shaft.torque
        _leave(shaft, np.stack([rest, rigid[0]]), np.stack([compliance * inertia, rigid[0]]))
        return Coupling(*rigid, rigid, rest, rigid[0])
    end = moved @ found + pushed[:, None] * (shaft.torque / shaft.rotor)
    _leave(shaft, end, np.tile(pushed[:, None], len(inertia)))
    lead, rate = found
    carried = (lead + retardation * rate) / compliance
    pull, felt = _mean(shaft, rate, end[1], pushed[1])
    return Coupling(pull, felt, (carried - shaft.torque, rigid[0]), lead, rate)


def _wound(shaft: Shaft, compliance: float, retardation: float) -> tuple[np.ndarray, np.ndarray]:
    """Lead and rate of a rotor without inertia: it carries all of the torque, and only its winding up takes time."""
    rest = compliance * shaft.torque
    lead = shaft.memory.get("lead", rest)
    decayed = np.exp(-shaft.step / retardation) if retardation > 0 else 0.0
    shaft.memory["lead"] = rest + (lead - rest) * decayed
    return lead, (shaft.memory["lead"] - lead) / shaft.step


def loose(shaft: Shaft, site: str, gap: float) -> Coupling:
    """Play: within it the rotor moves freely, at its ends it and the link push each other and do not bounce."""
    found, rigid = _arrived(shaft), (np.zeros_like(shaft.torque), np.full_like(shaft.torque, shaft.rotor))
    side = np.sign(shaft.torque) if found is None else shaft.memory["side"]
    last = shaft.memory.get("acceleration", rigid[0])
    lead, rate = (side * gap / 2, rigid[0]) if found is None else found
    if gap <= 0 or shaft.rotor <= 0:
        return Coupling(*rigid, rigid, side * gap / 2, rigid[0])
    # The link may have moved otherwise than was reckoned with, and met the rotor.
    side, begun = np.where(np.abs(lead) > gap / 2, np.sign(lead), side), rate
    lead, rate = np.clip(lead, -gap / 2, gap / 2), np.where(side == 0, rate, 0.0)
    side = np.where(side * (shaft.torque / shaft.rotor - last) > 0, side, 0.0)
    at_once = np.where(side == 0, -shaft.torque, 0.0), np.where(side == 0, 0.0, shaft.rotor)
    end, slope, shaft.memory["side"] = _through(shaft, np.stack([lead, rate]), side, last, gap)
    _leave(shaft, end, slope)
    pull, felt = _mean(shaft, begun, end[1], slope[1])
    return Coupling(pull, felt, at_once, lead, rate)


def _through(shaft: Shaft, end: np.ndarray, held: np.ndarray, last: np.ndarray, gap: float):
    """Lead and rate after the step where the link does not accelerate, (2, n), what they lose for each unit of its
    acceleration, (2, n), and the end of the play at which the rotor then is, 0 for none."""
    part, drive, (lead, rate) = shaft.step / PARTS, shaft.torque / shaft.rotor, end
    less, slower = np.zeros_like(end)
    for _ in range(PARTS):
        free = held == 0
        lead, less = lead + free * part * (rate + part / 2 * drive), less + free * part * (slower + part / 2)
        rate, slower = rate + free * part * drive, slower + free * part
        place = lead - less * last
        met = free & (np.abs(place) >= gap / 2)
        held = np.where(met, np.sign(place), held)
        lead = np.where(met, held * gap / 2, lead)
        less, rate, slower = (np.where(met, 0.0, own) for own in (less, rate, slower))
        held = np.where(held * (drive - last) > 0, held, 0.0)
    return np.stack([lead, rate]), np.stack([less, slower]), held


def _arrived(shaft: Shaft) -> np.ndarray | None:
    """Lead and rate now, (2, n), from what the step before left and how the link moved in it; None at first."""
    memory, end = shaft.memory, None
    if "end" in memory:
        memory["acceleration"] = (shaft.speed - memory["speed"]) / shaft.step
        end = memory["end"] - memory["slope"] * memory["acceleration"]
    memory["speed"] = shaft.speed
    return end


def _leave(shaft: Shaft, end: np.ndarray, slope: np.ndarray) -> None:
    shaft.memory["end"], shaft.memory["slope"] = end, slope


def _mean(shaft: Shaft, before: np.ndarray, after: np.ndarray, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force beside the motor's and inertia in the place of the armature: the rotor's own momentum is the rest."""
    share = shaft.rotor / shaft.step
    return -share * (after - before), np.broadcast_to(shaft.rotor - share * slope, before.shape)


def _swing(square: float, retardation: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact step of d'' = −square (d + retardation d') + u: of the state, (2, 2), and of u, (2,)."""
    half = retardation * square / 2
    fast = -half - np.emath.sqrt(half**2 - square * (1 + 1e-12j))
    slow = square / fast
    decayed = np.exp(slow * step), np.exp(fast * step)
    cross = ((decayed[0] - decayed[1]) / (slow - fast)).real
    stay = ((slow * decayed[1] - fast * decayed[0]) / (slow - fast)).real
    after = ((slow * decayed[0] - fast * decayed[1]) / (slow - fast)).real
    return np.array([[stay, cross], [-square * cross, after]]), np.array([(1 - stay) / square, cross])
