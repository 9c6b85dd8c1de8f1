"""Write concealed cases of robots as their owners have them, from models that are not committed.

python benchmarks/robots/make.py ROBOTS OUT --seed N [--only so101_friction,so101_servo,ur5e,go2]

ROBOTS is a folder with so101/, ur5e/ and go2/ (MuJoCo Menagerie and SO-ARM100). Each case is a folder: logs as the
robot's recorder writes them, of which the last is held out, case.yaml, and truth.json, for whoever marks the answers.
The naive model of the SO-101 is its own file, unaltered; those of the UR5e
and of the Go2 are their files without what joints have.
"""

import argparse
import json
import sys
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import yaml

sys.path.insert(0, str(Path(__file__).parents[1] / "rigs"))
from exact import make_exact, simulate
from folder import multisine
from walker import case_of as case_of_walker
from walker import record as record_walker
from walker import truth_of as truth_of_walker

COUNTS = 4096  # of the bus servos' encoders, per turn
SAMPLES = {"so101": 600, "ur5e": 1250}
PERIODS = {"so101": 0.02, "ur5e": 0.008}  # s
RUNS = ("monday", "tuesday", "wednesday")
HOME = {"so101": (0.0,) * 6, "ur5e": (-1.5708, -1.5708, 1.5708, -1.5708, -1.5708, 0.0)}  # rad
DROPPED = ("dof_damping", "dof_frictionloss", "dof_armature")


def so101_friction(robots: Path, rng: np.random.Generator) -> tuple:
    """Dry friction at the elbow beyond that of the model, and something in the gripper."""
    model = mujoco.MjModel.from_xml_path(str(robots / "so101" / "scene.xml"))
    friction, mass = 0.15 * np.exp(0.2 * rng.standard_normal()), 0.12
    hold(model, "gripper", mass, model.site("gripperframe").pos)
    more = {"elbow_flex": float(model.dof_frictionloss[model.joint("elbow_flex").dofadr[0]]) + friction}
    truth = {"coulomb@elbow_flex": {"friction": friction}, "payload@gripper": {"mass": mass}}
    return "so101", robots / "so101" / "scene.xml", sharpened(model, more), truth, 0.0


def so101_servo(robots: Path, rng: np.random.Generator) -> tuple:
    """Servos that are softer than the model's by 40 %, and late by 60 ms."""
    model = mujoco.MjModel.from_xml_path(str(robots / "so101" / "scene.xml"))
    model.actuator_gainprm[:, 0] *= 0.6
    model.actuator_biasprm[:, 1] *= 0.6
    truth = {"position_gain@all": {"change": -0.4}, "command_delay@all": {"delay": 0.06}}
    return "so101", robots / "so101" / "scene.xml", sharpened(model, {}), truth, 0.06


def ur5e(robots: Path, rng: np.random.Generator) -> tuple:
    """Dry and viscous friction and rotor inertia at all joints, none of which the naive model has."""
    path = robots / "ur5e" / "ur5e.xml"
    model = mujoco.MjModel.from_xml_path(str(path))
    names = [model.joint(j).name for j in range(model.njnt)]
    for field in DROPPED:
        getattr(model, field)[:] *= np.exp(0.2 * rng.standard_normal(model.nv))
    typical = np.array([8.0, 8.0, 6.0, 2.0, 2.0, 1.5]) * np.exp(0.2 * rng.standard_normal(6))  # N m
    model.dof_frictionloss[:] = np.where(model.dof_frictionloss > 0, model.dof_frictionloss, typical)
    truth = {}
    for name, v, f, a in zip(names, model.dof_damping, model.dof_frictionloss, model.dof_armature, strict=True):
        own = {"viscous": ("damping", v), "coulomb": ("friction", f), "rotor_inertia": ("inertia", a)}
        truth |= {f"{effect}@{name}": {key: float(size)} for effect, (key, size) in own.items() if size}
    return "ur5e", stripped(path), sharpened(model, {}), truth, 0.0


CASES = {made.__name__: made for made in (so101_friction, so101_servo, ur5e)}
WALKER = "go2"


def hold(model: mujoco.MjModel, body: str, mass: float, at: np.ndarray) -> None:
    """Put a point mass into the hand, at `at` of the body's frame."""
    i = model.body(body).id
    before, centre = model.body_mass[i], model.body_ipos[i].copy()
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[i])
    inertia = turn.reshape(3, 3) @ np.diag(model.body_inertia[i]) @ turn.reshape(3, 3).T
    after = (before * centre + mass * at) / (before + mass)
    for m, place in ((before, centre), (mass, at)):
        d = place - after
        inertia = inertia + m * (d @ d * np.eye(3) - np.outer(d, d))
    values, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.linalg.det(axes)
    model.body_mass[i], model.body_ipos[i], model.body_inertia[i] = before + mass, after, values
    mujoco.mju_mat2Quat(model.body_iquat[i], axes.ravel())
    mujoco.mj_setConst(model, mujoco.MjData(model))


def sharpened(model: mujoco.MjModel, friction: dict[str, float]) -> mujoco.MjModel:
    """The truth at small steps, with exact dry friction at every joint; `friction`: where it is not the model's.

    Nothing touches in the truth; `record` leaves out what would touch in the model.
    """
    names = [model.joint(j).name for j in range(model.njnt)]
    own = {name: float(model.dof_frictionloss[model.joint(name).dofadr[0]]) for name in names} | friction
    make_exact(model, {name: level for name, level in own.items() if level})
    model.geom_contype[:] = model.geom_conaffinity[:] = 0
    return model


def stripped(path: Path) -> str:
    """MJCF of a robot without what its joints have."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.copy_during_attach = False
    for joint in spec.joints:
        joint.damping, joint.frictionloss, joint.armature = 0.0 * np.asarray(joint.damping), 0.0, 0.0
    spec.compile()
    return spec.to_xml()


def record(robot: str, truth: mujoco.MjModel, touching: mujoco.MjModel, late: float, rng: np.random.Generator) -> tuple:
    """One log in free air: time, targets and positions in rad; `touching`: the model with what it may touch."""
    for share in 0.9 ** np.arange(20):
        log = move(robot, truth, late, share, rng)
        if not touches(touching, log[2]):
            return log
    raise SystemExit(f"{robot} touches itself however little it moves: give it another home")


def touches(model: mujoco.MjModel, positions: np.ndarray) -> bool:
    """Ask whether anything touches anywhere along a motion."""
    data = mujoco.MjData(model)
    for qpos in positions:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        if data.ncon:
            return True
    return False


def move(robot: str, truth: mujoco.MjModel, late: float, share: float, rng: np.random.Generator) -> tuple:
    """One motion, `share` as wide as may be."""
    period, samples = PERIODS[robot], SAMPLES[robot]
    time, targets, held = np.arange(samples) * period, [], round(late / period)
    for j in range(truth.nu):
        low, high = truth.actuator_ctrlrange[j]
        reach = share * min(0.6, 0.3 * (high - low))
        rates = np.r_[rng.uniform(0.05, 0.25, 2), rng.uniform(0.3, 0.8, 2)]
        middle = np.clip(HOME[robot][j], low + 1.2 * reach, high - 1.2 * reach)
        targets.append(middle + reach * multisine(time, rates, np.array([0.5, 0.3, 0.25, 0.15]), rng))
    targets = np.stack(targets, 1)

    def control(k, q, v):
        return targets[max(k - held, 0)]

    qpos = targets[0].copy()
    states, _ = simulate(truth, qpos, control, period, samples, settle=100)
    return time, targets, states[:, : truth.nq]


def write(name: str, robots: Path, out: Path, seed: int) -> None:
    """One case in a new folder."""
    rng = np.random.default_rng([seed, list(CASES).index(name)])
    robot, model, truth, effects, late = CASES[name](robots, rng)
    out.mkdir(parents=True)
    if isinstance(model, str):
        (out / "model.xml").write_text(model)
        model = "model.xml"
    touching = mujoco.MjModel.from_xml_path(str(out / model))  # an absolute path stays itself
    joints = [truth.joint(j).name for j in range(truth.njnt)]
    for run in RUNS:
        time, targets, positions = record(robot, truth, touching, late, rng)
        if robot == "so101":
            counts = np.round(positions / (2 * np.pi) * COUNTS) / COUNTS * 360
            columns = {"timestamp": time}
            columns |= {f"action.{j}.pos": np.degrees(c) for j, c in zip(joints, targets.T, strict=True)}
            columns |= {f"observation.state.{j}.pos": c for j, c in zip(joints, counts.T, strict=True)}
        else:
            seen = positions + 2e-5 * rng.standard_normal(positions.shape)
            columns = {"timestamp": time}
            columns |= {f"target_q_{i}": c for i, c in enumerate(targets.T)}
            columns |= {f"actual_q_{i}": c for i, c in enumerate(seen.T)}
        pd.DataFrame(columns).to_csv(out / f"{run}.csv", index=False, float_format="%.9g")
    (out / "case.yaml").write_text(yaml.safe_dump(case_of(robot, str(model), truth, joints), sort_keys=False))
    (out / "truth.json").write_text(json.dumps(effects, indent=1) + "\n")


def write_walker(robots: Path, out: Path, seed: int) -> None:
    """The Go2 in a new folder: with the motion capture of its trunk, and without it (`case-imu.yaml`)."""
    rng = np.random.default_rng([seed, len(CASES)])
    path = robots / "go2" / "go2.xml"
    truth, effects = truth_of_walker(path, rng)
    out.mkdir(parents=True)
    (out / "model.xml").write_text(stripped(path))
    for run in RUNS:
        pd.DataFrame(record_walker(truth, rng)).to_csv(out / f"{run}.csv", index=False, float_format="%.9g")
    for name, tracked in {"case": True, "case-imu": False}.items():
        runs = [{"file": f"{run}.csv"} for run in RUNS]
        runs[-1]["held_out"] = True
        table = {"model": "model.xml", "time": {"column": "time_s", "unit": "s"}, "runs": runs}
        table |= case_of_walker(truth, tracked)
        (out / f"{name}.yaml").write_text(yaml.safe_dump(table, sort_keys=False))
    (out / "truth.json").write_text(json.dumps(effects, indent=1) + "\n")


def case_of(robot: str, model: str, truth: mujoco.MjModel, joints: list[str]) -> dict:
    """The case file as an owner writes it."""
    hobby = robot == "so101"
    motors = [truth.actuator(j).name for j in range(truth.nu)]
    asked = [f"action.{j}.pos" if hobby else f"target_q_{i}" for i, j in enumerate(joints)]
    seen = [f"observation.state.{j}.pos" if hobby else f"actual_q_{i}" for i, j in enumerate(joints)]
    unit = "deg" if hobby else "rad"
    runs = [{"file": f"{run}.csv"} for run in RUNS]
    runs[-1]["held_out"] = True
    return {
        "model": model,
        "time": {"column": "timestamp", "unit": "s"},
        "runs": runs,
        "commands": {m: {"column": c, "unit": unit} for m, c in zip(motors, asked, strict=True)},
        "measurements": {j: {"column": c, "unit": unit} for j, c in zip(joints, seen, strict=True)},
        "window": 0.5,
    }


def main() -> None:
    """Make what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", type=Path, metavar="ROBOTS")
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default=",".join([*CASES, WALKER]))
    options = parser.parse_args()
    wanted = options.only.split(",")
    if unknown := set(wanted) - {*CASES, WALKER}:
        raise SystemExit(f"no robot is called {', '.join(sorted(unknown))}; there are {', '.join([*CASES, WALKER])}")
    for name in wanted:
        if name == WALKER:
            write_walker(options.robots.resolve(), options.out / name, options.seed)
        else:
            write(name, options.robots.resolve(), options.out / name, options.seed)
        print(options.out / name / "case.yaml", flush=True)


if __name__ == "__main__":
    main()
