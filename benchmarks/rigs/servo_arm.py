"""A six-servo arm: targets and log at 50 Hz, encoders of 4096 counts, no torque logged.

The naive model has links and servo gains, and nothing at the joints: no rotor inertia, no viscous and no dry friction.
Proportions and servos are those of small arms of six bus servos.
"""

import mujoco
import numpy as np
from exact import difference, make_exact, simulate
from folder import Made, multisine, round_to

PERIOD, SAMPLES, COUNTS, CENTRE = 0.02, 1000, 4096, 2048
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
ROTOR = np.array([0.022, 0.030, 0.024, 0.032, 0.025, 0.026])  # kg m^2, behind the gear
COULOMB = np.array([0.067, 0.092, 0.056, 0.055, 0.050, 0.058])  # N m
VISCOUS = 0.6  # N m s/rad
SPREAD = {"rotor": 0.1, "coulomb": 0.15, "viscous": 0.15}  # relative, about the typical sizes
FREED = ("upper_arm", "lower_arm", "gripper_frame")
MODEL = """\
<mujoco model="servo_arm">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <geom type="capsule" contype="0" conaffinity="0"/>
    <position kp="17.8" kv="0.05" forcerange="-3.35 3.35"/>
  </default>
  <worldbody>
    <geom name="base" fromto="0.02 0 0.02 0.02 0 0.05" size="0.03"/>
    <body name="shoulder" pos="0.039 0 0.062">
      <joint name="shoulder_pan" axis="0 0 1"/>
      <geom name="shoulder" fromto="0 0 0 0.03 0 0.054" size="0.025" mass="0.1"/>
      <body name="upper_arm" pos="0.03 0 0.054">
        <joint name="shoulder_lift" axis="0 1 0"/>
        <geom name="upper_arm" fromto="0 0 0 0.028 0 0.1126" size="0.018" mass="0.103"/>
        <body name="lower_arm" pos="0.028 0 0.1126">
          <joint name="elbow_flex" axis="0 1 0"/>
          <geom name="lower_arm" fromto="0 0 0 0.135 0 0.005" size="0.016" mass="0.104"/>
          <body name="wrist" pos="0.135 0 0.005">
            <joint name="wrist_flex" axis="0 1 0"/>
            <geom name="wrist" fromto="0 0 0 0.061 0 0.018" size="0.015" mass="0.079"/>
            <body name="gripper_frame" pos="0.061 0 0.018">
              <joint name="wrist_roll" axis="1 0 0"/>
              <geom name="gripper_frame" fromto="0 -0.01 0 0.08 -0.02 0" size="0.012" mass="0.087"/>
              <body name="jaw" pos="0.02 0.019 0">
                <joint name="gripper" axis="0 0 1"/>
                <geom name="jaw" fromto="0 0 0 0.06 0.01 0" size="0.006" mass="0.012"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder_pan" joint="shoulder_pan"/>
    <position name="shoulder_lift" joint="shoulder_lift"/>
    <position name="elbow_flex" joint="elbow_flex"/>
    <position name="wrist_flex" joint="wrist_flex"/>
    <position name="wrist_roll" joint="wrist_roll"/>
    <position name="gripper" joint="gripper"/>
  </actuator>
</mujoco>
"""


def make(seed: int) -> dict[str, Made]:
    """The case of one seed."""
    rng = np.random.default_rng([seed, 1])
    truth, sizes, masses = draw_truth(rng)
    targets = {name: draw_targets(rng) for name in ("a", "b", "c")}
    logs = {name: record(truth, target) for name, target in targets.items()}
    first = targets["a"]
    apart = difference(truth, first[0], lambda k, q, v: first[k], PERIOD, 40)
    effects = {
        f"{effect}@{joint}": {coefficient: float(size)}
        for (effect, coefficient), row in sizes.items()
        for joint, size in zip(JOINTS, row, strict=True)
    }
    return {"servo_arm": Made(MODEL, case(), logs, effects, masses, {"from_own_integration_rad": apart})}


def case() -> dict:
    """Tables of the case file."""
    return {
        "commands": {joint: {"column": f"{joint}_target", "unit": "rad"} for joint in JOINTS},
        "measurements": {
            joint: {
                "column": f"{joint}_counts",
                "unit": "counts",
                "quantity": "position",
                "counts_per_rev": COUNTS,
                "offset": -CENTRE,
            }
            for joint in JOINTS
        },
        "unknowns": [{"field": "mass", "site": body, "sd": 0.1} for body in FREED],
        "window": 0.5,
    }


def draw_truth(rng: np.random.Generator) -> tuple[mujoco.MjModel, dict, dict[str, float]]:
    """The real arm, sizes of what its naive model lacks by (effect, coefficient), and masses."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    rotor, coulomb, viscous = (
        typical * np.exp(spread * rng.standard_normal(6))
        for typical, spread in zip((ROTOR, COULOMB, VISCOUS), SPREAD.values(), strict=True)
    )
    model.dof_armature[:], model.dof_damping[:] = rotor, viscous
    masses = {}
    for body in FREED:
        number, factor = model.body(body).id, 1 + np.clip(0.05 * rng.standard_normal(), -0.1, 0.1)
        model.body_mass[number] *= factor
        model.body_inertia[number] *= factor
        masses[f"mass@{body}"] = float(model.body_mass[number])
    mujoco.mj_setConst(model, mujoco.MjData(model))
    make_exact(model, dict(zip(JOINTS, coulomb, strict=True)))
    names = ("rotor_inertia", "inertia"), ("coulomb", "friction"), ("viscous", "damping")
    return model, dict(zip(names, (rotor, coulomb, viscous), strict=True)), masses


def draw_targets(rng: np.random.Generator) -> np.ndarray:
    """Targets (T, 6), rad: slow and quick sines, and steps, at every joint."""
    time, out = np.arange(SAMPLES) * PERIOD, []
    for _ in JOINTS:
        rates = np.r_[rng.uniform(0.05, 0.25, 2), rng.uniform(0.3, 0.9, 2), rng.uniform(1.0, 2.0, 1)]
        path = multisine(time, rates, np.array([0.25, 0.2, 0.12, 0.1, 0.03]), rng)
        jumps = np.zeros(SAMPLES)
        at = np.sort(rng.choice(np.arange(50, SAMPLES - 50), 6, replace=False))
        jumps[at] = rng.uniform(0.04, 0.08, 6) * np.tile([1, -1], 3)
        out.append(path + np.cumsum(jumps))
    return np.stack(out, axis=1)


def record(truth: mujoco.MjModel, target: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of one run, begun at rest at its first target."""
    states, commands = simulate(truth, target[0], lambda k, q, v: target[k], PERIOD, SAMPLES, settle=100)
    rng = np.random.default_rng(0)
    counts = round_to(states[:, :6] / (2 * np.pi) * COUNTS + CENTRE, 0.0, 1.0, rng).astype(int)
    columns = {"time_s": np.arange(SAMPLES) * PERIOD}
    columns |= {f"{joint}_target": column for joint, column in zip(JOINTS, commands.T, strict=True)}
    return columns | {f"{joint}_counts": column for joint, column in zip(JOINTS, counts.T, strict=True)}
