"""Small robots whose logs tests write as an owner would: arms with motors or servos and sensors, and a flying body."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from case_files import write_case_of, write_csv

FINE, NOISE = 20, {"q": 2e-4, "v": 2e-3, "gyro": 5e-3, "acc": 5e-2, "turn": 5e-4, "force": 2e-2, "torque": 2e-3}
LINK = """<body name="link{i}" pos="{pos}"><joint name="j{i}" axis="{axis}" damping="0.1" range="-{most} {most}"/>
<geom type="capsule" fromto="0 0 0 {end}" size="0.02" mass="{mass}" contype="0" conaffinity="0"/>"""
TIP = """<site name="imu" pos="{end}" euler="20 10 30"/>"""
SENSORS = """<gyro name="gyro" site="imu"/><accelerometer name="acc" site="imu"/>
<framequat name="turn" objtype="site" objname="imu"/><force name="force" site="wrist"/>
<torque name="torque" site="wrist"/>"""
FLYER = """<mujoco><option timestep="0.002"/><worldbody><body name="hull" pos="0 0 2"><freejoint name="root"/>
<inertial pos="0 0 0" mass="0.9" diaginertia="0.004 0.007 0.009"/><site name="imu"/></body></worldbody>
<actuator><motor name="lift" site="imu" gear="0 0 1 0 0 0"/><motor name="roll" site="imu" gear="0 0 0 1 0 0"/>
<motor name="pitch" site="imu" gear="0 0 0 0 1 0"/><motor name="yaw" site="imu" gear="0 0 0 0 0 1"/></actuator>
<sensor><framepos name="place" objtype="xbody" objname="hull"/><framequat name="turn" objtype="xbody" objname="hull"/>
<gyro name="gyro" site="imu"/><accelerometer name="acc" site="imu"/></sensor></mujoco>"""


def arm(seed: int, joints: int, servo: bool = False) -> str:
    """A random arm of this many hinges, with an IMU at its tip and a force sensor at its last link."""
    rng, bodies, close, pos = np.random.default_rng(seed), "", "", "0 0 1"
    for i in range(joints):
        end = f"0 0 -{rng.uniform(0.15, 0.4):.3f}"
        axis = ("0 1 0", "1 0 0")[int(rng.random() < 0.4)] if i else "0 1 0"
        bodies += LINK.format(i=i, pos=pos, axis=axis, end=end, mass=round(rng.uniform(0.2, 0.9), 3), most=170)
        pos, close = end, close + "</body>"
    bodies += TIP.format(end=end) + '<site name="wrist"/>'
    kind = '<position name="m{i}" joint="j{i}" kp="30" kv="1.5"/>' if servo else '<motor name="m{i}" joint="j{i}"/>'
    drives = "".join(kind.format(i=i) for i in range(joints))
    speeds = "".join(f'<jointpos name="q{i}" joint="j{i}"/><jointvel name="v{i}" joint="j{i}"/>' for i in range(joints))
    return (
        f'<mujoco><option timestep="0.002"/><worldbody>{bodies}{close}</worldbody><actuator>{drives}</actuator>'
        f"<sensor>{speeds}{SENSORS}</sensor></mujoco>"
    )


def waves(rng: np.random.Generator, count: int, size: np.ndarray, period: float) -> np.ndarray:
    """Commands (T, nu): sums of sines up to 1.5 Hz."""
    rate, phase = rng.uniform(0.2, 1.5, (3, len(size))), rng.uniform(0, 6.3, (3, len(size)))
    time = np.arange(count)[:, None, None] * period
    return size * np.sin(2 * np.pi * rate * time + phase).sum(axis=1) / np.sqrt(1.5)


def wrong_masses(rng: np.random.Generator, model: mujoco.MjModel) -> None:
    """Make a robot of a model: masses 10 to 30 % off, dry and viscous friction that the model lacks."""
    for body in range(1, model.nbody):
        factor = 1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.3)
        model.body_mass[body] *= factor
        model.body_inertia[body] *= factor
    hinges = model.jnt_dofadr[model.jnt_type == 3]
    model.dof_frictionloss[hinges] = rng.uniform(0.02, 0.1, len(hinges))
    model.dof_damping[hinges] *= rng.uniform(1, 3, len(hinges))


@cache
def log(
    xml: str, seed: int, seconds: float = 8.0, period: float = 0.01, wrong: bool = False, late: int = 0
) -> dict[str, np.ndarray]:
    """Columns of a run: t, each command as u_NAME, each sensor's components as NAME or NAME_i."""
    model = mujoco.MjModel.from_xml_string(xml)
    rng = np.random.default_rng(1000 + seed)
    if wrong:
        wrong_masses(np.random.default_rng(77), model)
        mujoco.mj_setConst(model, mujoco.MjData(model))
    model.opt.timestep, data = period / FINE, mujoco.MjData(model)
    count = round(seconds / period)
    ctrl = _commands(model, rng, count, period)
    rows = []
    if model.jnt_type[0] == 0:
        data.qvel[3:] = rng.normal(0, 2.0, 3)
    for k in range(count):
        mujoco.mj_forward(model, data)
        rows.append(data.sensordata.copy())
        data.ctrl[:] = ctrl[max(0, k - late)]
        mujoco.mj_step(model, data, FINE)
    read = np.array(rows)
    out = {"t": np.arange(count) * period} | {f"u_{model.actuator(i).name}": ctrl[:, i] for i in range(model.nu)}
    for i in range(model.nsensor):
        sensor, at = model.sensor(i), model.sensor_adr[i]
        noise = NOISE.get(sensor.name.rstrip("0123456789"), 1e-3)
        values = read[:, at : at + sensor.dim[0]] + noise * rng.standard_normal((count, sensor.dim[0]))
        out |= {name: values[:, k] for k, name in enumerate(names(sensor.name, sensor.dim[0]))}
    return out


def _commands(model: mujoco.MjModel, rng: np.random.Generator, count: int, period: float) -> np.ndarray:
    if model.jnt_type[0] == 0:
        mass = model.body_mass[1]
        hover = np.array([mass * 9.81, 0, 0, 0])
        return hover + waves(rng, count, np.array([1.0, 0.02, 0.02, 0.02]), period)
    servo = model.actuator_biasprm[0, 1] < 0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    reach = np.array([0.5] * model.nu) if servo else 0.35 * _weights(model)
    return waves(rng, count, reach, period)


def _weights(model: mujoco.MjModel) -> np.ndarray:
    """Torque (nu,) that holds a level arm at each joint."""
    arms = [sum(model.body_mass[b + 1 :]) * 9.81 * 0.2 for b in range(model.nv)]
    return np.array(arms)


def names(sensor: str, size: int) -> list[str]:
    """Columns of a sensor."""
    return [sensor] if size == 1 else [f"{sensor}_{k}" for k in range(size)]


UNITS = {"q": "rad", "v": "rad/s", "gyro": "rad/s", "acc": "m/s^2", "turn": "1", "place": "m", "force": "N"}
UNITS |= {"torque": "N m"}


def case(xml: str, used: list[str], command_units: dict[str, str]) -> dict:
    """A case of the sensors `used`, in SI units."""
    model = mujoco.MjModel.from_xml_string(xml)
    measurements = {}
    for name in used:
        size, unit = int(model.sensor(name).dim[0]), UNITS[name.rstrip("0123456789")]
        key = {"column": name} if size == 1 else {"columns": names(name, size)}
        measurements[name] = key | {"unit": unit}
    drives = {model.actuator(i).name: i for i in range(model.nu)}
    wanted = {name: command_units.get(name, "N m") for name in drives}
    commands = {name: {"column": f"u_{name}", "unit": unit} for name, unit in wanted.items()}
    for name in drives if "place" in used else ():
        commands[name]["ctrl_unit"] = wanted[name]
    return {
        "model": "arm.xml",
        "time": {"column": "t", "unit": "s"},
        "runs": [{"file": "a.csv"}, {"file": "b.csv", "held_out": True}],
        "commands": commands,
        "measurements": measurements,
        "window": 0.5,
    }


Change = Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]]


def write(folder: Path, xml: str, used: list[str], units: dict[str, str], changes: dict[str, Change], **keys) -> Path:
    """The case in `folder`, its runs a and b changed by `changes` (of "a" and "b")."""
    options = {key: keys.pop(key) for key in ("wrong", "late", "period", "seconds") if key in keys}
    for run, seed in (("a", 1), ("b", 2)):
        columns = log(xml, seed, **options)
        write_csv(folder / f"{run}.csv", columns | changes.get(run, lambda c: {})(columns))
    return write_case_of(folder, case(xml, used, units) | keys, xml)
