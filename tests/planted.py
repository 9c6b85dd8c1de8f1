"""A two-link arm recorded by MuJoCo C at a tenth of the model's step, with or without something hidden in it."""

from collections.abc import Callable

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from fimpact.recordings import Recording, Run, Unknown

ARM = """
<mujoco>
  <option timestep="0.0025" gravity="0 0 0"/>
  <default><joint axis="0 0 1" damping="0.05"/><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="link_1">
      <joint name="joint_1"/>
      <inertial pos="0.15 0 0" mass="0.5" diaginertia="1e-4 0.004 0.004"/>
      <body name="link_2" pos="0.3 0 0">
        <joint name="joint_2"/>
        <inertial pos="0.15 0 0" mass="0.5" diaginertia="1e-4 0.004 0.004"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="motor_1" joint="joint_1"/><motor name="motor_2" joint="joint_2"/></actuator>
  <sensor><jointpos name="encoder_1" joint="joint_1"/><jointpos name="encoder_2" joint="joint_2"/></sensor>
</mujoco>
"""
PERIOD, SAMPLES, FINE, NOISE = 0.005, 240, 20, 2e-4
UNKNOWNS = (
    Unknown("mass", "link_1", 0.12),
    Unknown("mass", "link_2", 0.12),
    Unknown("damping", "joint_1", 0.2),
    Unknown("damping", "joint_2", 0.2),
)


def record(seed: int, hide: Callable[[mujoco.MjModel], None] = lambda model: None, runs: int = 9) -> Recording:
    """Two thirds of `runs` to train on; masses and damping are some 10 % off the model's. `hide` edits the truth."""
    rng = np.random.default_rng(seed)
    model = _truth(rng)
    hide(model)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    made = [_run(model, rng, f"run_{i}", i >= 2 * runs // 3) for i in range(runs)]
    channels = ("encoder_1", "encoder_2")
    return Recording(
        ARM, ".", PERIOD, channels, tuple(made), UNKNOWNS, np.full(2, np.nan), np.full(4, np.inf), window=0.4
    )


def _truth(rng: np.random.Generator) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(ARM)
    spec.option.timestep, spec.option.integrator = PERIOD / FINE, mujoco.mjtIntegrator.mjINT_RK4
    model = spec.compile()
    off = 1 + 0.1 * rng.standard_normal((2, 1))
    model.body_mass[1:] *= off[:, 0]
    model.body_inertia[1:] *= off
    model.dof_damping *= 1 + 0.1 * rng.standard_normal(2)
    return model


def _run(model: mujoco.MjModel, rng: np.random.Generator, name: str, held_out: bool) -> Run:
    time = np.arange(SAMPLES) * PERIOD
    waves = rng.uniform(0.5, 3, (3, 2)), rng.uniform(0, 2 * np.pi, (3, 2)), rng.standard_normal((3, 2)) * [0.4, 0.15]
    frequency, phase, size = waves
    ctrl = (size * np.sin(2 * np.pi * frequency * time[:, None, None] + phase)).sum(1)
    start = np.concatenate([[0.0], rng.uniform(-1, 1, 2), np.zeros(2)])[None]
    _, sensed = Rollout(nthread=0).rollout(model, mujoco.MjData(model), start, np.repeat(ctrl, FINE, 0)[None])
    measured = sensed[0, ::FINE] + NOISE * rng.standard_normal((SAMPLES, 2))
    return Run(name, ctrl, measured, held_out)
