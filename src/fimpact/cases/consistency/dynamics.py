"""The tie of rigid-body dynamics: commands, weight and inertia of the naive model must balance in the recorded motion.

A naive model is wrong, that is the point of recording; but no missing physics makes it right again when one column is
read in degrees, 1000 times smaller, reversed, or exchanged with another.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from fimpact.cases import enums
from fimpact.cases.consistency.balance import Balance, balances_of
from fimpact.cases.consistency.kinematics import ORDERS, Log
from fimpact.cases.consistency.measured_motion import SMOOTHERS
from fimpact.cases.consistency.misreadings import Misreading, Positions, misread, misreadings
from fimpact.cases.consistency.ties import DECLARED, FEWEST, MODEL_ERROR, NOTHING, Left, Reading, Tie, bounded, least

HOPEFUL = 0.5  # share that a reading may leave at first sight to be looked at closely
CLIP_PERCENTILES = (60, 98)  # percentiles of acceleration up to which samples weigh in full; the better counts
FRICTION = 10.0  # friction decelerates at most this many times as strongly as recorded
SCALE = 4.0  # masses of a naive model may be this much off
ROTOR = 10.0  # inertia of a drive is at most this many times that of the model
LATE = (0.0, 0.02, 0.05, 0.1, 0.2)  # s: delays of a command that are honest


def dynamics_ties(log: Log) -> Iterator[Tie]:
    """Whether the naive model balances where nothing touches; of a free body also how it turns in flight."""
    model, columns = log.model, log.columns()
    if not model.njnt or any(len(columns.get(model.joint(j).name, ())) not in (1, 7) for j in range(model.njnt)):
        return
    if any(int(kind) not in enums.PLAIN_STATES for kind in model.actuator_dyntype):
        return
    joints = [_dofs(model, j) for j in range(model.njnt)]
    balances = balances_of(log, columns)
    several = [dofs for dofs in joints if dofs.size]
    readings = tuple(misreadings(log))
    what = "the commands, the naive model and the recorded accelerations"
    yield Tie(what, log.names, readings, _left(log, balances, several, readings), MODEL_ERROR)
    spins = [int(model.jnt_dofadr[j]) + np.arange(3, 6) for j in np.flatnonzero(model.jnt_type == enums.FREE)]
    quats = [channel for channel in log.seen if channel.type == enums.FRAMEQUAT]
    if spins and quats:
        what = f"how '{quats[0].sensor}' turns in flight and the inertia of the naive model"
        yield Tie(what, log.names, tuple(ORDERS), _left(log, balances, spins, tuple(ORDERS)), EVEN)


EVEN = 0.1  # share that tumbling may leave where ratios of inertia are off: rows are scaled one by one


def _dofs(model: mujoco.MjModel, joint: int) -> np.ndarray:
    # Of a free joint only the translation: its rotation is a tie of its own.
    return model.jnt_dofadr[joint] + np.arange(3 if model.jnt_type[joint] == enums.FREE else 1)


def _left(log: Log, balances, joints: list[np.ndarray], readings: tuple[Reading, ...]):
    """What a reading leaves in a group; those that change commands only are compared in one go."""
    alike: dict[Positions, list[Misreading]] = {}
    for reading in (DECLARED, *readings):
        alike.setdefault(misread(reading).positions, []).append(misread(reading))

    @cache
    def moving(group: int) -> list[np.ndarray]:
        """Joints that move as declared: under every reading the same are compared."""
        balance = balances(Positions(), group, SMOOTHERS[1], True)
        power = [np.sum(balance.own[:, dofs] ** 2) for dofs in joints]
        return [dofs for dofs, size in zip(joints, power, strict=True) if size > 1e-9 * max(power) > 0]

    @cache
    def all_left(positions: Positions, group: int) -> dict[Misreading, Left]:
        first = _found(log, balances, moving(group), group, positions, alike[positions], quick=True)
        hopeful = [one for one, left in first.items() if left.share < HOPEFUL or not one.doubt]
        closer = _found(log, balances, moving(group), group, positions, hopeful, quick=False) if hopeful else {}
        return first | {one: left for one, left in closer.items() if left is not NOTHING}

    return lambda reading, group: all_left(misread(reading).positions, group)[misread(reading)]


def _found(log: Log, balances, joints, group: int, positions: Positions, readings: list[Misreading], quick: bool):
    """What readings of the same positions leave; quickly: at one width and without a delay."""
    out = dict.fromkeys(readings, NOTHING)
    for width in SMOOTHERS[1:2] if quick else SMOOTHERS:
        balance = balances(positions, group, width, quick)
        if joints and len(balance.rows) >= FEWEST:
            commands = _commands(log, group, readings, LATE[:1] if quick or not log.model.nu else LATE)
            found = _unbalanced(
                balance, commands, joints, readings, CLIP_PERCENTILES[1:] if quick else CLIP_PERCENTILES
            )
            out = {reading: least([out[reading], one]) for reading, one in zip(out, found, strict=True)}
    return out


def _commands(log: Log, group: int, readings: list[Misreading], delays: tuple[float, ...]) -> np.ndarray:
    """Commands (delays, readings, n, nu) of all samples of a group."""
    runs = [log.recording.runs[run].ctrl for run in log.groups[group]]
    shifts = [round(late / log.recording.period) for late in delays]
    late = [np.concatenate([ctrl[np.maximum(np.arange(len(ctrl)) - shift, 0)] for ctrl in runs]) for shift in shifts]
    return np.array([[reading.commands(ctrl) for reading in readings] for ctrl in late])


def _unbalanced(balance: Balance, commands: np.ndarray, moving: list[np.ndarray], readings: list[Misreading], caps):
    """What each reading leaves at the delay and the cap that suit it: the mean of all joints, whose units differ."""
    ctrl = commands[:, :, balance.rows]
    for index, reading in enumerate(readings):
        if reading.unsigned is not None:
            ctrl[:, index] = [_directed(balance, one, reading.unsigned) for one in ctrl[:, index]]
    forces = np.einsum("drnu,nuv->drnv", balance.gain * ctrl + balance.bias, balance.arms)
    several = [_problem(balance, forces, dofs, cap) for cap in caps for dofs in moving]
    found = bounded(
        *(np.concatenate([getattr(one, key) for one in several]) for key in ("gram", "cross", "low", "high"))
    )
    left = [one.left(part) for one, part in zip(several, np.split(found, len(several)), strict=True)]
    shares = np.array([np.sum(one**2, axis=1) for one in left]).clip(0.0, 1.0)
    shares = shares.reshape(len(caps), len(moving), *forces.shape[:2]).mean(axis=1)
    out = []
    for index, reading in enumerate(readings):
        cap, delay = np.unravel_index(np.argmin(shares[:, :, index]), shares.shape[:2])
        kept = left[cap * len(moving) : (cap + 1) * len(moving)] if not reading.doubt else []
        rests = [one.reshape(*forces.shape[:2], -1)[delay, index] for one in kept] or [np.zeros(0)]
        out.append(Left(float(shares[cap, delay, index]), np.concatenate(rests), LATE[delay]))
    return out


def _directed(balance: Balance, ctrl: np.ndarray, actuator: int) -> np.ndarray:
    """Commands with the size of one as recorded, in the direction in which the motion needs it."""
    needed = balance.inertia + balance.weight + balance.moving
    towards = np.einsum("nv,nv->n", needed, balance.arms[:, actuator] * balance.gain[:, [actuator]])
    out = ctrl.copy()
    out[:, actuator] = np.abs(ctrl[:, actuator]) * np.sign(towards)
    return out


@dataclass(frozen=True)
class Problem:
    """Least squares of one joint for each delay and reading, and last of friction alone (B + 1 in all).

    columns: (B, k, n). target: (n,). own: (n,), by which what is left is judged: the target has inertia of other
    joints, too, and where a reading makes one joint's motion small, would be all that is left to explain. low, high: as
    `bounded` has them.
    """

    columns: np.ndarray
    target: np.ndarray
    own: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def gram(self) -> np.ndarray:
        """Products of the columns with one another."""
        out = self.columns @ self.columns.transpose(0, 2, 1)
        return np.concatenate([out, out[:1]])

    @property
    def cross(self) -> np.ndarray:
        """Products of the columns with the target."""
        return np.concatenate([self.columns @ self.target, self.columns[:1] @ self.own])

    def left(self, found: np.ndarray) -> np.ndarray:
        """Residuals (B, n), in units of what friction alone leaves."""
        alone = self.own - found[-1] @ self.columns[0]
        rests = self.target - np.einsum("bk,bkn->bn", found[:-1], self.columns)
        return rests / max(float(np.linalg.norm(alone)), 1e-300)


def _problem(balance: Balance, forces: np.ndarray, dofs: np.ndarray, cap: float) -> Problem:
    """What of the force of inertia at a joint the other forces (delays, readings, n, nv) make up.

    Each term may be `SCALE` times larger or smaller, because inertias are guesses; friction and the drive's inertia
    may help. Beyond the percentile `cap` an impact weighs no more: one a sample early would hide everything else.
    """
    size = np.linalg.norm(balance.inertia[:, dofs], axis=1)
    weight = np.minimum(1.0, 2 * np.percentile(size, cap) / np.maximum(size, 1e-300))[:, None]

    def row(values: np.ndarray) -> np.ndarray:
        return (weight * values[..., dofs]).reshape(*values.shape[:-2], -1)

    target = row(balance.inertia)
    drag = [-row(balance.v), -row(np.sign(balance.v))]
    given = np.array([-row(balance.weight), -row(balance.moving), -row(balance.a), *drag])
    acting = row(forces).reshape(-1, 1, len(target))
    columns = np.concatenate([acting, np.broadcast_to(given, (len(acting), *given.shape))], axis=1)
    own = np.linalg.norm(target)
    strongest = [FRICTION * own / max(float(np.linalg.norm(x)), 1e-300) for x in drag]
    rotor = ROTOR * own / max(float(np.linalg.norm(given[2])), 1e-300)
    low, high = [1 / SCALE, 1 / SCALE, 0.0, 0.0, 0.0, 0.0], [SCALE, SCALE, SCALE, rotor, *strongest]
    lows = np.array([*[low] * len(acting), [0.0] * 6])
    return Problem(columns, target, row(balance.own), lows, np.array([*[high] * len(acting), [0.0] * 4 + strongest]))
