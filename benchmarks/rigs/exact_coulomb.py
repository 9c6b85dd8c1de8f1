"""The arm of docs/index.md with exact Coulomb friction, 0.03 N m, by steps of our own without MuJoCo; two noises."""

from math import sin

import mujoco
import numpy as np
from folder import Made

PERIOD, SAMPLES, STEP = 0.01, 1000, 2e-5
FRICTION = 0.03  # N m
NOISES = {"exact_coulomb_quiet": 2e-4, "exact_coulomb_noisy": 1e-3}  # rad
MODEL = """\
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body name="arm">
      <joint name="shoulder" axis="0 1 0" damping="0.02"/>
      <geom name="rod" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02" mass="0.6" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator><motor name="drive" joint="shoulder"/></actuator>
</mujoco>
"""
CASE = {
    "commands": {"drive": {"column": "drive_Nm", "unit": "N m"}},
    "measurements": {"shoulder": {"column": "shoulder_rad", "unit": "rad"}},
    "unknowns": [
        {"field": "mass", "site": "arm", "sd": 0.2},
        {"field": "damping", "site": "shoulder", "sd": 0.5},
    ],
    "window": 0.5,
}


def make(seed: int) -> dict[str, Made]:
    """Both cases of one seed: the same motions, measured well and badly."""
    rng = np.random.default_rng([seed, 3])
    paces = {"a": 1.0, "b": rng.uniform(0.7, 0.9), "c": 1.3}
    motions = {name: swing(command(pace, rng.uniform(0, 2 * np.pi))) for name, pace in paces.items()}
    return {name: _made(motions, noise, rng) for name, noise in NOISES.items()}


def _made(motions: dict[str, tuple[np.ndarray, np.ndarray]], noise: float, rng: np.random.Generator) -> Made:
    logs = {
        name: {
            "time_s": np.arange(SAMPLES) * PERIOD,
            "drive_Nm": drive,
            "shoulder_rad": angle + noise * rng.standard_normal(SAMPLES),
        }
        for name, (drive, angle) in motions.items()
    }
    effects = {"coulomb@shoulder": {"friction": FRICTION}}
    return Made(MODEL, CASE, logs, effects, {"mass@arm": 0.6, "damping@shoulder": 0.02}, {"noise_rad": noise})


def command(pace: float, phase: float) -> np.ndarray:
    """Torques (T,), N m, of the controller in docs/index.md."""
    time = np.arange(SAMPLES) * PERIOD
    return 0.8 * np.sin(2 * pace * time) + 0.5 * np.sin(5 * pace * time + phase)


def swing(drive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The torques, and angles (T,) of the arm by midpoint steps, its friction against the speed or as much as holds."""
    inertia, weight, damping = _numbers()
    angle, speed, angles = 0.0, 0.0, []
    for torque in drive:
        angles.append(angle)
        for _ in range(round(PERIOD / STEP)):
            half = _rubbed(speed, (torque - weight * sin(angle) - damping * speed) / inertia, inertia, STEP / 2)
            middle = angle + STEP / 2 * speed
            after = _rubbed(speed, (torque - weight * sin(middle) - damping * half) / inertia, inertia, STEP)
            angle, speed = angle + STEP / 2 * (speed + after), after
    return drive, np.array(angles)


def _rubbed(speed: float, pace: float, inertia: float, time: float) -> float:
    """Speed after `time` s at the acceleration `pace` and friction, which stops the arm if it can."""
    free, most = speed + time * pace, time * FRICTION / inertia
    return free - min(max(free, -most), most)


def _numbers() -> tuple[float, float, float]:
    """Inertia about the joint (kg m^2), weight times its arm (N m), damping (N m s/rad)."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data, mass = mujoco.MjData(model), np.zeros((1, 1))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    data.qpos[0] = np.pi / 2
    mujoco.mj_forward(model, data)
    return float(mass[0, 0]), abs(float(data.qfrc_bias[0])), float(model.dof_damping[0])
