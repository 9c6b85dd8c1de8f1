"""Rigs recorded by MuJoCo at a step far finer than the model's, with or without physics that the model lacks."""

from collections.abc import Callable, Sequence
from functools import cache

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from fimpact.recordings import Recording, Run, Unknown
from fimpact.simulation.nonsmooth import make_friction_exact

PERIOD, FINE = 0.01, 50

ROD = """<mujoco><option timestep="0.005"/><worldbody><body name="rod"><joint name="pivot" axis="0 1 0" damping="0.02"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.015" mass="0.3" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor name="motor" joint="pivot"/></actuator>
<sensor><jointpos name="angle" joint="pivot"/></sensor></mujoco>"""
BALL = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="2 2 0.1"/>
<body name="ball" pos="0 0 0.3"><freejoint name="free"/><geom name="ball" size="0.05" mass="0.3"/></body></worldbody>
<sensor><framepos name="place" objtype="xbody" objname="ball"/></sensor></mujoco>"""
ARM = """<mujoco><option timestep="0.005"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.02"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/>
<body name="lower" pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" damping="0.02"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.3"/></body></body></worldbody>
<actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator>
<sensor><jointpos name="q1" joint="shoulder"/><jointpos name="q2" joint="elbow"/></sensor></mujoco>"""


def waves(samples: int, size: Sequence[float], seed: int, period: float = PERIOD) -> np.ndarray:
    """Commands (T, nu): sums of three sines between 0.3 and 2 Hz, of this root mean square size or so."""
    rng, time = np.random.default_rng(seed), np.arange(samples) * period
    rate, phase = rng.uniform(0.3, 2, (3, len(size))), rng.uniform(0, 2 * np.pi, (3, len(size)))
    return np.asarray(size) * np.sin(2 * np.pi * rate * time[:, None, None] + phase).sum(1) * np.sqrt(2 / 3)


def record(
    xml: str,
    channels: Sequence[str],
    commands: Sequence[np.ndarray],
    noise: float | Sequence[float],
    hide: Callable[[mujoco.MjModel], None] = lambda model: None,
    pull: Callable[[mujoco.MjModel, mujoco.MjData], np.ndarray] | None = None,
    unknowns: Sequence[Unknown] = (),
    starts: Sequence[tuple] = (),
    period: float = PERIOD,
    fine: int = FINE,
    seed: int = 0,
) -> Recording:
    """The rig `xml` under `commands`, (T, nu) of each run; of several, the last one is held out.

    Args:
        hide: edits the truth. pull: a force, (nv,), in each of its steps. starts: (qpos, qvel) of each run.
    """
    rng, base = np.random.default_rng(seed), mujoco.MjModel.from_xml_string(xml)
    truth = mujoco.MjModel.from_xml_string(xml)
    truth.opt.timestep, truth.opt.integrator = period / fine, mujoco.mjtIntegrator.mjINT_RK4
    hide(truth)
    make_friction_exact(truth, base)
    mujoco.mj_setConst(truth, mujoco.MjData(truth))
    noise = np.broadcast_to(np.asarray(noise, float), len(channels))
    runs = []
    for i, ctrl in enumerate(commands):
        qpos, qvel = starts[i] if starts else (base.qpos0, np.zeros(base.nv))
        read = (_pulled if pull else _played)(truth, ctrl, qpos, qvel, fine, pull)[:, _columns(base, channels)]
        measured = read + noise * rng.standard_normal(read.shape)
        runs.append(Run(f"run_{i}", ctrl, measured, 0 < i == len(commands) - 1))
    free = np.full(2 * base.nv, np.inf)
    return Recording(xml, ".", period, tuple(channels), tuple(runs), tuple(unknowns), np.array(noise), free, 0.0)


def _columns(model: mujoco.MjModel, channels: Sequence[str]) -> list[int]:
    parts = (name.removesuffix("]").partition("[") for name in channels)
    return [int(model.sensor(name).adr[0]) + int(part or 0) for name, _, part in parts]


def _played(truth, ctrl, qpos, qvel, fine, _) -> np.ndarray:
    start = np.concatenate([[0.0], qpos, qvel, np.zeros(truth.na)])[None]
    sensed = Rollout(nthread=0).rollout(truth, mujoco.MjData(truth), start, np.repeat(ctrl, fine, 0)[None])[1]
    return sensed[0, ::fine]


def _pulled(truth, ctrl, qpos, qvel, fine, pull) -> np.ndarray:
    data, rows = mujoco.MjData(truth), []
    data.qpos[:], data.qvel[:] = qpos, qvel
    for own in ctrl:
        data.ctrl[:] = own
        for k in range(fine):
            data.qfrc_applied[:] = pull(truth, data)
            mujoco.mj_step(truth, data)
            if k == 0:
                rows.append(data.sensordata.copy())
    return np.array(rows)


def rub(friction: Sequence[float], damping: Sequence[float] = ()) -> Callable[[mujoco.MjModel], None]:
    """Hide dry friction, and viscous friction beside the model's, at the degrees of freedom."""

    def hide(model: mujoco.MjModel) -> None:
        model.dof_frictionloss[:] += friction
        if len(damping):
            model.dof_damping[:] += damping

    return hide


@cache
def rod(friction: float = 0.0, mass: float = 1.0, free: bool = False) -> Recording:
    """A rod under a motor, two runs of 4 s and one held out; dry friction, N m, and how much too light its model is."""

    def hide(model: mujoco.MjModel) -> None:
        model.dof_frictionloss[:] = friction
        model.body_mass[1:] *= mass
        model.body_inertia[1:] *= mass

    unknowns = (Unknown("mass", "rod", 0.3), Unknown("damping", "pivot", 0.5)) if free else ()
    return record(ROD, ("angle",), [waves(400, [0.5], i) for i in range(3)], 1e-3, hide, unknowns=unknowns)


@cache
def arm(friction: tuple[float, float] = (0.0, 0.0), damping: tuple[float, float] = (0.0, 0.0)) -> Recording:
    """A hanging two-link arm, three runs of 4 s and one held out, with friction, N m and N m s/rad, at its joints."""
    commands = [waves(400, [1.0, 0.25], 10 + i) for i in range(4)]
    unknowns = (Unknown("mass", "upper", 0.1), Unknown("mass", "lower", 0.1))
    return record(ARM, ("q1", "q2"), commands, 5e-4, rub(friction, damping), unknowns=unknowns)
