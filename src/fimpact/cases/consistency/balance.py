"""Balances of forces: what commands, weight and inertia of the naive model are in the recorded motion."""

from copy import copy
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np

from fimpact.cases import enums
from fimpact.cases.consistency.kinematics import Log, reordered
from fimpact.cases.consistency.measured_motion import Motion, moved
from fimpact.cases.consistency.misreadings import Positions
from fimpact.cases.consistency.ties import FEWEST, Reading

SAMPLES = 300  # states that are compared
NEAR = 0.1  # of the size of a geom: so close to another it may touch in reality


@dataclass(frozen=True)
class Balance:
    """Generalised forces in n states: of inertia, of a joint's own inertia, weight, speed (n, nv), and of actuators.

    bias, gain: force of each actuator without a command, and by one unit of it, (n, nu). arms: (n, nu, nv).
    speed, acceleration: (n, nv). rows: indices of the samples in the concatenated runs of a group.
    """

    inertia: np.ndarray
    own: np.ndarray
    weight: np.ndarray
    moving: np.ndarray
    bias: np.ndarray
    gain: np.ndarray
    arms: np.ndarray
    v: np.ndarray
    a: np.ndarray
    rows: np.ndarray


def balances_of(log: Log, columns: dict[str, list[int]]):
    """What makes the balance of a group of runs, for positions as they are read, a width of smoothing and a speed."""
    careful, blind = _without_contact_forces(log.model), _without_contact_forces(log.model)
    blind.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT

    @cache
    def motion(order: Reading, run: int, width: int) -> Motion:
        measured = reordered(log, log.recording.runs[run].measured, order)
        return moved(log.model, columns, measured, log.recording.period, width)

    @cache
    def balances(read: Positions, group: int, width: int, quick: bool) -> Balance:
        model = blind if quick else careful
        parts, count = [], 0
        for run in log.groups[group]:
            states = read.states(model, motion(read.order, run, width))
            known = np.flatnonzero(np.isfinite(np.column_stack(states)).all(axis=1))
            parts.append((*(one[known] for one in states), count + known))
            count += len(states[0])
        q, v, a, rows = (np.concatenate(one) for one in zip(*parts, strict=True))
        most = max(4 * FEWEST, SAMPLES // len(log.groups)) // (2 if quick else 1)
        chosen = np.unique(np.linspace(0, len(q) - 1, most).astype(int)) if len(q) else np.zeros(0, int)
        return _balance(model, q[chosen], v[chosen], a[chosen], rows[chosen])

    return balances


def _balance(model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, a: np.ndarray, rows: np.ndarray) -> Balance:
    """Forces in each state in which nothing touches and no joint is at its limit."""
    data, kept, found = mujoco.MjData(model), [], []
    for row in range(len(q)):
        one = _forces(model, data, q[row], v[row], a[row])
        if one is not None:
            kept.append(row)
            found.append(one)
    shapes = [(model.nv,)] * 4 + [(model.nu,)] * 2 + [(model.nu, model.nv)]
    arrays = [np.array([one[k] for one in found]).reshape(len(kept), *shape) for k, shape in enumerate(shapes)]
    inertia, own, weight, moving, bias, gain, arms = arrays
    return Balance(inertia, own, weight, moving, bias, gain, arms, v[kept], a[kept], rows[kept])


def _forces(model: mujoco.MjModel, data: mujoco.MjData, q: np.ndarray, v: np.ndarray, a: np.ndarray):
    """Inertia, a joint's own, weight, what comes of speed (nv), bias and gain (nu) and lever arms (nu, nv) of the
    actuators, without the directions that a closed loop forbids; None where something touches."""
    data.qpos[:], data.qvel[:], data.ctrl[:], data.act[:] = q, v, 0.0, 0.0
    mujoco.mj_fwdPosition(model, data)
    kinds_of = data.efc_type[: data.nefc]
    if data.ncon or (kinds_of > enums.LAST_FRICTION).any():
        return None
    mujoco.mj_fwdVelocity(model, data)
    masses, all_bias, weight = np.zeros((model.nv, model.nv)), data.qfrc_bias.copy(), np.zeros(model.nv)
    mujoco.mj_fullM(model, data, masses)
    passive, lifted = data.qfrc_passive.copy(), data.qfrc_gravcomp.copy()
    bias, arms = _acting(model, data, 0.0)
    gain = _acting(model, data, 1.0)[0] - bias
    free = _free(model, data, kinds_of)
    data.qvel[:] = 0
    mujoco.mj_comVel(model, data)
    mujoco.mj_rne(model, data, 0, weight)
    speed = all_bias - weight - passive + lifted
    return (
        free @ masses @ a,
        free @ (np.diag(masses) * a),
        free @ (weight - lifted),
        free @ speed,
        bias,
        gain,
        arms @ free,
    )


def _acting(model: mujoco.MjModel, data: mujoco.MjData, command: float) -> tuple[np.ndarray, np.ndarray]:
    """Force of each actuator (nu,) under this command, and its lever arms (nu, nv)."""
    data.ctrl[:], data.act[:] = command, command
    mujoco.mj_fwdActuation(model, data)
    arms = np.zeros((model.nu, model.nv))
    if model.nu:
        mujoco.mju_sparse2dense(arms, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    return data.actuator_force.copy(), arms


def _free(model: mujoco.MjModel, data: mujoco.MjData, rows: np.ndarray) -> np.ndarray:
    """Projector (nv, nv) on the motions that equality constraints leave."""
    tied = data.efc_J.reshape(-1, model.nv)[: len(rows)][rows == enums.EQUALITY] if model.neq else np.zeros((0, 1))
    return np.eye(model.nv) - np.linalg.pinv(tied) @ tied if len(tied) else np.eye(model.nv)


def _without_contact_forces(model: mujoco.MjModel) -> mujoco.MjModel:
    """The same model, which reports contacts before they exert a force (real surfaces are some millimetres off), and
    whose actuators clip nothing."""
    model, sizes = copy(model), model.geom_rbound[model.geom_rbound > 0]
    near = NEAR * float(np.median(sizes)) if sizes.size else 0.0
    for margin, gap in ((model.geom_margin, model.geom_gap), (model.pair_margin, model.pair_gap)):
        margin += near
        gap += near
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model.actuator_ctrllimited[:] = model.actuator_forcelimited[:] = 0
    return model
