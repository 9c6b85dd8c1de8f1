"""The state believed at the start of a run: given in the case, or read off its first samples."""

import mujoco
import numpy as np

from fimpact.cases import enums
from fimpact.cases.channels import Channel
from fimpact.cases.errors import CaseError, one_of
from fimpact.cases.quaternions import quaternions

FIRST = 10  # samples from which a first position and speed are read
SIZES = {enums.FREE: (7, 6), enums.BALL: (4, 3), enums.SLIDE: (1, 1), enums.HINGE: (1, 1)}


def checked(model: mujoco.MjModel, start: dict, where: str) -> dict:
    """`start`, if its joints exist and its vectors have their sizes.

    Raises:
        CaseError: otherwise.
    """
    names = [model.joint(j).name for j in range(model.njnt)]
    for joint, entry in start.items():
        one_of(names, joint, "joint", f"{where}.{joint}")
        sizes = SIZES[int(model.joint(joint).type[0])]
        for key, size in zip(("position", "velocity"), sizes, strict=True):
            if key in entry and np.size(entry[key]) != size:
                raise CaseError(f"{where}.{joint}.{key} has {np.size(entry[key])} numbers; it must have {size}")
    return start


def prior(model: mujoco.MjModel, start: dict) -> np.ndarray:
    """Prior standard deviation (2 nv,) of qpos and qvel at the start of a run; inf where none is given."""
    out = np.full(2 * model.nv, np.inf)
    for joint, entry in start.items():
        address = model.joint(joint).dofadr[0]
        dofs = SIZES[int(model.joint(joint).type[0])][1]
        for shift, key in ((0, "position_sd"), (model.nv, "velocity_sd")):
            out[shift + address : shift + address + dofs] = entry.get(key, np.inf)
    return out


def estimated_start(model, channels: list[Channel], measured: np.ndarray, period: float, start: dict):
    """qpos (nq,) and qvel (nv,) at the first row of `measured` (T, ny), or (None, None) where it shows them itself."""
    columns = position_columns(model, channels)
    hinges = all(model.jnt_type[j] in (enums.SLIDE, enums.HINGE) for j in range(model.njnt))
    if not start and hinges and len(columns) == model.njnt:
        return None, None
    return _state(model, columns, measured, period, start)


def as_model(model, channels: list[Channel], measured: np.ndarray, period: float, start: dict) -> np.ndarray:
    """`measured` (T, ny) with every quaternion of the sign that the model's sensor has at the start: q and -q are one
    rotation, but their difference is not 0."""
    out, data = measured.copy(), None
    for channel, place in quaternions(channels):
        rows = np.flatnonzero(np.isfinite(measured[:, place]).all(axis=1))[:1]
        if len(rows):
            data = data or _placed(model, *_state(model, position_columns(model, channels), measured, period, start))
            said = data.sensor(channel.sensor).data
            out[:, place] *= -1.0 if measured[rows[0], place] @ said < 0 else 1.0
    return out


def _placed(model, qpos: np.ndarray, qvel: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, data)
    return data


def _state(model, columns: dict[str, list[int]], measured: np.ndarray, period: float, start: dict):
    """qpos (nq,) and qvel (nv,): what is given, else what is measured, else those of the MJCF."""
    qpos, qvel = model.qpos0.copy(), np.zeros(model.nv)
    for joint, place in columns.items():
        q, v = model.joint(joint).qposadr[0], model.joint(joint).dofadr[0]
        position, velocity = _first(measured[:, place], period)
        qpos[q : q + len(position)], qvel[v : v + len(velocity)] = position, velocity
    for joint, entry in start.items():
        for key, target, address in (("position", qpos, "qposadr"), ("velocity", qvel, "dofadr")):
            if key in entry:
                first = getattr(model.joint(joint), address)[0]
                target[first : first + np.size(entry[key])] = entry[key]
    return qpos, qvel


def position_columns(model: mujoco.MjModel, channels: list[Channel]) -> dict[str, list[int]]:
    """Joints whose whole position is measured, and the columns (1 or 7) that hold it."""
    at, out = {}, {}
    column = 0
    for channel in channels:
        at[channel.sensor] = list(range(column, column + len(channel.columns)))
        column += len(channel.columns)
    for channel in channels:
        if channel.type == enums.JOINTPOS:
            out[channel.joint] = at[channel.sensor]
    for j in np.flatnonzero(model.jnt_type == enums.FREE):
        pose = [_frame(model, at, kind, model.jnt_bodyid[j]) for kind in (enums.FRAMEPOS, enums.FRAMEQUAT)]
        if all(pose):
            out[model.joint(j).name] = pose[0] + pose[1]
    return out


def _frame(model: mujoco.MjModel, at: dict, kind: int, body: int) -> list[int]:
    for name, columns in at.items():
        sensor = model.sensor(name)
        if (sensor.type[0], sensor.objid[0]) == (kind, body) and sensor.objtype[0] in _frames(model, kind, body):
            return columns
    return []


def _frames(model: mujoco.MjModel, kind: int, body: int) -> tuple[int, ...]:
    """Kinds of object of which a sensor reads the pose that qpos holds: those of a body's centre of mass where that is
    its origin."""
    centred = not model.body_ipos[body].any()
    straight = kind == enums.FRAMEPOS or abs(model.body_iquat[body, 0]) == 1.0
    return (enums.XBODY, enums.BODY) if centred and straight else (enums.XBODY,)


def _first(values: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and speed at the first row, from a parabola through the first samples."""
    rows = np.flatnonzero(np.isfinite(values).all(axis=1))[:FIRST]
    time, known = rows * period, values[rows]
    if len(rows) < 4:
        return (known[0] if len(rows) else np.zeros(values.shape[1])), np.zeros(max(1, values.shape[1] - 1))
    if values.shape[1] == 1:
        fit = np.polyfit(time, known[:, 0], 2)
        return fit[2:], fit[1:2]
    linear = np.polyfit(time, known[:, :3], 2)
    turn = np.polyfit(time, _rotations(known[0, 3:], known[:, 3:]), 2)
    quat = known[0, 3:] / np.linalg.norm(known[0, 3:])
    mujoco.mju_quatIntegrate(quat, turn[2], 1.0)
    return np.concatenate([linear[2], quat]), np.concatenate([linear[1], turn[1]])


def _rotations(origin: np.ndarray, quats: np.ndarray) -> np.ndarray:
    """Rotation vectors (n, 3) in body axes that lead from `origin` to each of `quats` (n, 4)."""
    out = np.zeros((len(quats), 3))
    for row, quat in enumerate(quats):
        mujoco.mju_subQuat(out[row], quat / np.linalg.norm(quat), origin / np.linalg.norm(origin))
    return out
