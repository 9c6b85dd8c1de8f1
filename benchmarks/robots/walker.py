"""A Go2 that squats, sways, trots in place and hops, as its recorder and a motion capture of its trunk see it."""

from pathlib import Path

import mujoco
import numpy as np
from exact import make_exact, simulate
from folder import multisine, round_to

PERIOD, SAMPLES = 0.004, 750
STEP = 2e-4  # s, of the truth
LEGS = ("FR", "FL", "RR", "RL")  # as motors come
SEGMENT = 0.213  # m, of thigh and of calf
HEIGHT = 0.29  # m, from hip to foot at rest
KP, KD = 100.0, 2.0  # N m/rad, N m s/rad: the drives' own law of the targets
ENCODER = 2 * np.pi / 2**15  # rad
GYRO, ACCELEROMETER = 2e-3, 0.05  # rad/s, m/s^2
TRACKED, TURNED = 2e-4, 5e-4  # m, and of a quaternion's components
DRAWN = ("dof_damping", "dof_frictionloss", "dof_armature")
MODES = ("squat", "trot", "hop")


def truth_of(path: Path, rng: np.random.Generator) -> tuple[mujoco.MjModel, dict]:
    """The real robot, and what its drives have that the naive model lacks."""
    model, effects = mujoco.MjModel.from_xml_path(str(path)), {}
    driven = slice(6, model.nv)
    for field in DRAWN:
        getattr(model, field)[driven] *= np.exp(0.2 * rng.standard_normal(model.nv - 6))
    for joint in range(1, model.njnt):
        name, dof = model.joint(joint).name, model.jnt_dofadr[joint]
        effects |= {
            f"viscous@{name}": {"damping": float(model.dof_damping[dof])},
            f"coulomb@{name}": {"friction": float(model.dof_frictionloss[dof])},
            f"rotor_inertia@{name}": {"inertia": float(model.dof_armature[dof])},
        }
    rubbing = {model.joint(j).name: float(model.dof_frictionloss[model.jnt_dofadr[j]]) for j in range(1, model.njnt)}
    make_exact(model, rubbing, STEP)
    return model, effects


def targets(rng: np.random.Generator) -> np.ndarray:
    """Targets of the twelve joints, (T, 12), rad: one way to move after the other."""
    time = np.arange(SAMPLES) * PERIOD
    length = HEIGHT + np.zeros((SAMPLES, 4))
    stride, spread = np.zeros((2, SAMPLES, 4))
    order = rng.permutation(len(MODES))
    share = (np.arange(SAMPLES) * len(MODES) / SAMPLES).astype(int)
    weight = [_eased(share == k) for k in range(len(MODES))]
    for k, mode in enumerate(order):
        length += weight[k][:, None] * _lengths(MODES[mode], time, rng)
    own = np.array([1, -1, 1, -1])  # of a leg's side, seen from its hip
    roll, pitch, sway = (multisine(time, rng.uniform(0.5, 2.0, 3), size * np.array([0.5, 0.3, 0.2]), rng)
                         for size in (0.02, 0.02, 0.12))  # fmt: skip
    length += roll[:, None] * own + pitch[:, None] * np.array([1, 1, -1, -1])
    stride += multisine(time, rng.uniform(0.4, 1.8, 3), np.array([0.07, 0.05, 0.03]), rng)[:, None]
    spread += sway[:, None]
    bend = np.arccos(np.clip(length / (2 * SEGMENT), 0.3, 0.95))
    return np.stack([spread, bend + stride, -2 * bend], 2).reshape(SAMPLES, 12)


def _eased(mask: np.ndarray) -> np.ndarray:
    """A weight that comes and goes within 0.2 s."""
    width = round(0.2 / PERIOD)
    return np.convolve(np.pad(mask.astype(float), width, "edge"), np.ones(width) / width, "same")[width:-width]


def _lengths(mode: str, time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """By how much each leg is longer than at rest, (T, 4), m."""
    phase = 2 * np.pi * rng.uniform(*{"squat": (1.0, 1.8), "trot": (1.6, 2.2), "hop": (1.8, 2.2)}[mode]) * time
    if mode == "trot":
        legs = phase[:, None] + np.pi * np.array([0, 1, 1, 0])
        return -0.07 * np.maximum(np.sin(legs), 0.0)
    return (0.035 if mode == "squat" else 0.05) * np.sin(phase)[:, None] * np.ones(4)


def record(truth: mujoco.MjModel, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of one run, in which the robot neither falls nor strikes a joint's stop."""
    for _ in range(20):
        states, torques, wanted = _move(truth, rng)
        if _stays_up(truth, states):
            return _columns(truth, states, torques, wanted, rng)
    raise SystemExit("the Go2 falls however it moves")


def _move(truth: mujoco.MjModel, rng: np.random.Generator):
    wanted = targets(rng)
    place = np.array([truth.jnt_qposadr[j] for j in truth.actuator_trnid[:, 0]])
    dofs = np.array([truth.jnt_dofadr[j] for j in truth.actuator_trnid[:, 0]])
    most = truth.actuator_ctrlrange[:, 1]

    def control(sample, qpos, qvel):
        return np.clip(KP * (wanted[sample] - qpos[place]) - KD * qvel[dofs], -most, most)

    qpos = truth.key("home").qpos.copy()
    qpos[place] = wanted[0]
    qpos[2] = 0.32
    states, torques = simulate(truth, qpos, control, PERIOD, SAMPLES, settle=250)
    return states, torques, wanted


def _stays_up(model: mujoco.MjModel, states: np.ndarray) -> bool:
    """Whether the trunk stays up and level, and no joint at its stop."""
    low, high = model.jnt_range[1:].T
    tilted = 1 - 2 * (states[:, 4] ** 2 + states[:, 5] ** 2) < 0.8
    stopped = (states[:, 7 : model.nq] < low) | (states[:, 7 : model.nq] > high)
    return not (tilted.any() or stopped.any() or (states[:, 2] < 0.15).any())


def _columns(truth, states, torques, wanted, rng) -> dict[str, np.ndarray]:
    motors = [truth.actuator(i).name for i in range(truth.nu)]
    place = [truth.jnt_qposadr[j] for j in truth.actuator_trnid[:, 0]]
    spin, push = _felt(truth, states, torques)
    columns = {"time_s": np.arange(SAMPLES) * PERIOD}
    columns |= {f"{m}_target": c for m, c in zip(motors, wanted.T, strict=True)}
    columns |= {f"{m}_tau": c for m, c in zip(motors, torques.T, strict=True)}
    columns |= {f"{m}_q": round_to(states[:, q], 3e-5, ENCODER, rng) for m, q in zip(motors, place, strict=True)}
    columns |= {f"gyro_{a}": c + GYRO * rng.standard_normal(SAMPLES) for a, c in zip("xyz", spin.T, strict=True)}
    columns |= {
        f"acc_{a}": c + ACCELEROMETER * rng.standard_normal(SAMPLES) for a, c in zip("xyz", push.T, strict=True)
    }
    columns |= {f"base_{a}": states[:, i] + TRACKED * rng.standard_normal(SAMPLES) for i, a in enumerate("xyz")}
    turned = states[:, 3:7] + TURNED * rng.standard_normal((SAMPLES, 4))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return columns | {f"base_q{a}": c for a, c in zip("wxyz", turned.T, strict=True)}


def _felt(truth: mujoco.MjModel, states: np.ndarray, torques: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What gyroscope and accelerometer read at each sample, (T, 3) each, in the axes of the IMU."""
    data, site, found = mujoco.MjData(truth), truth.site("imu").id, np.zeros((2, len(states), 6))
    for k, (row, torque) in enumerate(zip(states, torques, strict=True)):
        data.qpos[:], data.qvel[:], data.ctrl[:] = row[: truth.nq], row[truth.nq :], torque
        mujoco.mj_forward(truth, data)
        mujoco.mj_rnePostConstraint(truth, data)
        mujoco.mj_objectVelocity(truth, data, mujoco.mjtObj.mjOBJ_SITE, site, found[0, k], 1)
        mujoco.mj_objectAcceleration(truth, data, mujoco.mjtObj.mjOBJ_SITE, site, found[1, k], 1)
    return found[0, :, :3], found[1, :, 3:]


def case_of(truth: mujoco.MjModel, tracked: bool) -> dict:
    """Tables of the case file but model, time and runs; tracked: with the motion capture of the trunk."""
    motors = [(truth.actuator(i).name, truth.joint(truth.actuator_trnid[i, 0]).name) for i in range(truth.nu)]
    seen = {joint: {"column": f"{motor}_q", "unit": "rad"} for motor, joint in motors}
    seen["gyro"] = {
        "site": "imu",
        "quantity": "rotation_rate",
        "columns": [f"gyro_{a}" for a in "xyz"],
        "unit": "rad/s",
    }
    seen["accelerometer"] = {
        "site": "imu", "quantity": "acceleration", "columns": [f"acc_{a}" for a in "xyz"], "unit": "m/s^2"
    }  # fmt: skip
    if tracked:
        seen["trunk"] = {"body": "base", "quantity": "position", "columns": [f"base_{a}" for a in "xyz"], "unit": "m"}
        seen["trunk turned"] = {
            "body": "base", "quantity": "orientation", "columns": [f"base_q{a}" for a in "wxyz"], "unit": "1"
        }  # fmt: skip
    return {
        "commands": {motor: {"column": f"{motor}_tau", "unit": "N m"} for motor, _ in motors},
        "measurements": seen,
        "window": 0.1,
    }
