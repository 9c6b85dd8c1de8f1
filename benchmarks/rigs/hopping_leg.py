"""A leg that hops along a rail: hip and knee driven by torques, a stiff foot, 500 Hz, no force plate.

Three masses are believed some per cent off. One case lacks nothing beside, of the other the knee has dry friction.
"""

import mujoco
import numpy as np
from exact import make_exact, simulate
from folder import Made, round_to

PERIOD, SAMPLES = 0.002, 3000
STEP = 5e-5  # s, of the truth: the foot is stiff
NOISE, QUANTUM = np.array([5e-5, 1e-4, 1e-4]), np.array([1e-5, 2 * np.pi / 2**15, 2 * np.pi / 2**15])  # m, rad, rad
CHANNELS = {"rail": "m", "hip": "rad", "knee": "rad"}
FRICTION = 0.35  # N m, typical of such a knee
SD = {"trunk": 0.1, "thigh": 0.15, "shank": 0.2}
MODEL = """\
<mujoco model="hopping_leg">
  <compiler angle="radian"/>
  <option timestep="0.0005" integrator="implicitfast" cone="elliptic"/>
  <default><geom type="capsule" contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 0.1"/>
    <body name="trunk" pos="0 0 0.6">
      <joint name="rail" type="slide" axis="0 0 1" ref="0.6"/>
      <geom name="trunk" type="box" size="0.08 0.05 0.05" mass="2.4"/>
      <body name="thigh">
        <joint name="hip" axis="0 1 0" armature="0.006" damping="0.05"/>
        <geom name="thigh" fromto="0 0 0 0 0 -0.25" size="0.025" mass="0.9"/>
        <body name="shank" pos="0 0 -0.25">
          <joint name="knee" axis="0 1 0" armature="0.006" damping="0.05"/>
          <geom name="shank" fromto="0 0 0 0 0 -0.25" size="0.015" mass="0.35"/>
          <geom name="foot" type="sphere" pos="0 0 -0.25" size="0.02" mass="0.05"/>
        </body>
      </body>
    </body>
  </worldbody>
  <contact>
    <pair name="foot_floor" geom1="floor" geom2="foot" condim="3" solref="0.004 1" friction="0.8 0.8"/>
  </contact>
  <actuator>
    <motor name="hip" joint="hip"/>
    <motor name="knee" joint="knee"/>
  </actuator>
</mujoco>
"""


def make(seed: int) -> dict[str, Made]:
    """Both cases of one seed."""
    rng = np.random.default_rng([seed, 2])
    friction = float(FRICTION * np.exp(0.15 * rng.standard_normal()))
    return {"hopping_leg": _made(rng, 0.0), "hopping_leg_coulomb": _made(rng, friction)}


def _made(rng: np.random.Generator, friction: float) -> Made:
    truth, masses = draw_truth(rng, friction)
    logs = {name: record(truth, hop(rng), rng) for name in ("a", "b", "c")}
    flights = {name: float((foot(log) > 1e-3).mean()) for name, log in logs.items()}
    effects = {"coulomb@knee": {"friction": friction}} if friction else {}
    return Made(MODEL, case(), logs, effects, masses, {"flight": flights})


def case() -> dict:
    """Tables of the case file."""
    return {
        "commands": {joint: {"column": f"{joint}_Nm", "unit": "N m"} for joint in ("hip", "knee")},
        "measurements": {joint: {"column": f"{joint}_{unit}", "unit": unit} for joint, unit in CHANNELS.items()},
        "unknowns": [{"field": "mass", "site": body, "sd": sd} for body, sd in SD.items()],
        "window": 0.1,
    }


def draw_truth(rng: np.random.Generator, friction: float) -> tuple[mujoco.MjModel, dict[str, float]]:
    """The real leg and its masses."""
    model, masses = mujoco.MjModel.from_xml_string(MODEL), {}
    for body, sd in SD.items():
        number, factor = model.body(body).id, 1 + np.clip(sd * rng.standard_normal(), -1.5 * sd, 1.5 * sd) / 2
        model.body_mass[number] *= factor
        model.body_inertia[number] *= factor
        masses[f"mass@{body}"] = float(model.body_mass[number])
    mujoco.mj_setConst(model, mujoco.MjData(model))
    make_exact(model, {"knee": friction} if friction else {}, STEP)
    return model, masses


def foot(log: dict[str, np.ndarray]) -> np.ndarray:
    """How far the foot is above the floor, (T,), m."""
    hip, both = log["hip_rad"], log["hip_rad"] + log["knee_rad"]
    return log["rail_m"] - 0.25 * (np.cos(hip) + np.cos(both)) - 0.02


def hop(rng: np.random.Generator):
    """A controller that bends and stretches the leg, at a rate (Hz) and by an angle (rad) that vary in the run."""
    time = np.arange(SAMPLES) * PERIOD
    rate, bend, push = (np.interp(time, np.linspace(0, time[-1], 7), rng.uniform(*span, 7))
                        for span in ((1.8, 2.8), (1.0, 1.3), (0.35, 0.6)))  # fmt: skip
    phase, lean = 2 * np.pi * np.cumsum(rate) * PERIOD, 0.08 * np.sin(2 * np.pi * rng.uniform(0.3, 0.6) * time)
    knee = bend - push * np.sin(phase)

    def control(sample, qpos, qvel):
        wanted = np.array([-knee[sample] / 2 + lean[sample], knee[sample]])
        return np.clip(np.array([60.0, 70.0]) * (wanted - qpos[1:]) - np.array([1.2, 1.2]) * qvel[1:], -16, 16)

    return control


def record(truth: mujoco.MjModel, control, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of one run, begun as the leg falls to the floor."""
    states, commands = simulate(truth, np.array([0.5, -0.55, 1.1]), control, PERIOD, SAMPLES)
    columns = {"time_s": np.arange(SAMPLES) * PERIOD, "hip_Nm": commands[:, 0], "knee_Nm": commands[:, 1]}
    for number, (joint, unit) in enumerate(CHANNELS.items()):
        columns[f"{joint}_{unit}"] = round_to(states[:, number], NOISE[number], QUANTUM[number], rng)
    return columns
