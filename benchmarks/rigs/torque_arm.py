"""A six-axis arm with torque motors at 250 Hz: with nothing missing, and with viscous friction missing at one joint.

Proportions are those of an arm that carries 5 kg. The naive model has the rotors' inertia and the viscous friction of
the drives, right but for that one joint; three masses are believed a few per cent off.
"""

import mujoco
import numpy as np
from exact import difference, make_exact, simulate
from folder import Made, multisine, round_to

PERIOD, SAMPLES = 0.004, 2500
NOISE, QUANTUM = 2e-5, 2 * np.pi / 2**17  # rad
JOINTS = ("pan", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
DAMPING = np.array([9.0, 9.0, 7.8, 2.2, 2.0, 1.6])  # N m s/rad
STIFF, BRAKE = np.array([900.0, 900, 600, 80, 80, 40]), np.array([120.0, 120, 80, 6, 6, 3])  # of the controller
FREED = ("upper_arm", "forearm", "flange")
MODEL = """\
<mujoco model="torque_arm">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><geom type="capsule" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="shoulder" pos="0 0 0.163">
      <joint name="pan" axis="0 0 1" armature="0.6" damping="{0}"/>
      <geom name="shoulder" fromto="0 0 0 0 0.1 0" size="0.06" mass="3.7"/>
      <body name="upper_arm" pos="0 0.138 0">
        <joint name="lift" axis="0 1 0" armature="0.6" damping="{1}"/>
        <geom name="upper_arm" fromto="0 0 0 0 0 0.425" size="0.05" mass="8.4"/>
        <body name="forearm" pos="0 -0.131 0.425">
          <joint name="elbow" axis="0 1 0" armature="0.4" damping="{2}"/>
          <geom name="forearm" fromto="0 0 0 0 0 0.392" size="0.04" mass="2.3"/>
          <body name="wrist_1" pos="0 0 0.392">
            <joint name="wrist_1" axis="0 1 0" armature="0.05" damping="{3}"/>
            <geom name="wrist_1" fromto="0 0.02 0 0 0.11 0" size="0.04" mass="1.2"/>
            <body name="wrist_2" pos="0 0.127 0">
              <joint name="wrist_2" axis="0 0 1" armature="0.05" damping="{4}"/>
              <geom name="wrist_2" fromto="0 0 0.02 0 0 0.08" size="0.04" mass="1.2"/>
              <body name="flange" pos="0 0 0.1">
                <joint name="wrist_3" axis="0 1 0" armature="0.05" damping="{5}"/>
                <geom name="flange" fromto="0 0 0 0.04 0.1 0" size="0.03" mass="0.8"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="pan" joint="pan"/>
    <motor name="lift" joint="lift"/>
    <motor name="elbow" joint="elbow"/>
    <motor name="wrist_1" joint="wrist_1"/>
    <motor name="wrist_2" joint="wrist_2"/>
    <motor name="wrist_3" joint="wrist_3"/>
  </actuator>
</mujoco>
"""


def make(seed: int) -> dict[str, Made]:
    """Both cases of one seed."""
    rng = np.random.default_rng([seed, 4])
    joint = int(rng.integers(4))
    return {"torque_arm": _made(rng, None), "torque_arm_viscous": _made(rng, joint)}


def _made(rng: np.random.Generator, lacking: int | None) -> Made:
    """A case; lacking: the joint of which the naive model does not know the viscous friction."""
    believed, effects = DAMPING.copy(), {}
    truth, masses = draw_truth(rng)
    if lacking is not None:
        believed[lacking] = 0.0
        truth.dof_damping[lacking] *= np.exp(0.15 * rng.standard_normal())
        effects[f"viscous@{JOINTS[lacking]}"] = {"damping": float(truth.dof_damping[lacking])}
    logs, apart = {}, 0.0
    for name in ("a", "b", "c"):
        control, start = follow(draw_path(rng))
        apart = apart or difference(truth, start, control, PERIOD, 50)
        logs[name] = record(truth, control, start, rng)
    return Made(MODEL.format(*believed), case(), logs, effects, masses, {"from_own_integration_rad": apart})


def case() -> dict:
    """Tables of the case file."""
    return {
        "commands": {joint: {"column": f"{joint}_Nm", "unit": "N m"} for joint in JOINTS},
        "measurements": {joint: {"column": f"{joint}_rad", "unit": "rad"} for joint in JOINTS},
        "unknowns": [{"field": "mass", "site": body, "sd": 0.1} for body in FREED],
        "window": 0.1,
    }


def draw_truth(rng: np.random.Generator) -> tuple[mujoco.MjModel, dict[str, float]]:
    """The real arm and its masses."""
    model, masses = mujoco.MjModel.from_xml_string(MODEL.format(*DAMPING)), {}
    for body in FREED:
        number, factor = model.body(body).id, 1 + np.clip(0.05 * rng.standard_normal(), -0.1, 0.1)
        model.body_mass[number] *= factor
        model.body_inertia[number] *= factor
        masses[f"mass@{body}"] = float(model.body_mass[number])
    mujoco.mj_setConst(model, mujoco.MjData(model))
    make_exact(model, {})
    return model, masses


def draw_path(rng: np.random.Generator) -> np.ndarray:
    """Where the arm should be, (T, 6), rad."""
    time, centre = np.arange(SAMPLES) * PERIOD, np.array([0.0, 0.5, 0.9, 0.2, 0.3, 0.0])
    rates = [np.r_[rng.uniform(0.1, 0.3, 2), rng.uniform(0.4, 0.9, 2)] for _ in JOINTS]
    sizes = np.array([0.35, 0.25, 0.12, 0.08])
    path = np.stack([multisine(time, own, sizes, rng) for own in rates], axis=1)
    return centre + path * (1 - np.exp(-time / 0.5))[:, None]


def follow(path: np.ndarray):
    """A controller that knows the gravity of the believed arm, and where it starts, (6,)."""
    model = mujoco.MjModel.from_xml_string(MODEL.format(*DAMPING))
    data, speed = mujoco.MjData(model), np.gradient(path, PERIOD, axis=0)

    def control(sample, qpos, qvel):
        data.qpos[:], data.qvel[:] = qpos, 0
        mujoco.mj_forward(model, data)
        return data.qfrc_bias + STIFF * (path[sample] - qpos) + BRAKE * (speed[sample] - qvel)

    return control, path[0]


def record(truth: mujoco.MjModel, control, start: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of one run."""
    states, commands = simulate(truth, start, control, PERIOD, SAMPLES)
    angles = round_to(states[:, :6], NOISE, QUANTUM, rng)
    columns = {"time_s": np.arange(SAMPLES) * PERIOD}
    columns |= {f"{joint}_Nm": column for joint, column in zip(JOINTS, commands.T, strict=True)}
    return columns | {f"{joint}_rad": column for joint, column in zip(JOINTS, angles.T, strict=True)}
