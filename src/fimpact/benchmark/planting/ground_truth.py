"""A rig to which physics is added, and its simulation in MuJoCo C: finely for the truth, coarsely for planning."""

import copy
from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np
from mujoco import rollout
from scipy.interpolate import CubicSpline

from fimpact.benchmark.rigs.rig import Rig
from fimpact.support.mujoco_setup import hush

FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
HELD = 2.5e-4  # s
SETTLINGS = 4  # of joints that give little
LOCKED = 1e6  # kg m^2, of a shaft that does not turn
FIRM = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp: gives a ten-thousandth of what soft constraints would
PROMPT = 2.0  # steps, time constant of dry friction: the least that MuJoCo takes; it stops a joint within one step
AXES = ("com_x", "com_y", "com_z")
DRIVEN = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_QFRC_APPLIED
hush()


@dataclass
class World:
    """What is simulated, before it is compiled.

    spec: the mechanism. delays: of each channel, s, (ny,). hooks: each makes, from (model, data) of one run, a function
    called before every step. commands: each maps commands per step (runs, N, nu) and the step in s to those that reach
    the motors. senses: each maps samples (runs, T, ny) to what the instruments report. drift: how much
    faster the recorder's clock is read than true time, s/s. shafts: joints that were added between motors and links.
    settled: springy joints that were added and begin where they hold what they carry.
    """

    rig: Rig
    spec: mujoco.MjSpec
    steps: int
    delays: np.ndarray
    hooks: list[Callable] = field(default_factory=list)
    commands: list[Callable] = field(default_factory=list)
    senses: list[Callable] = field(default_factory=list)
    drift: float = 0.0
    shafts: list[str] = field(default_factory=list)
    settled: list[str] = field(default_factory=list)

    @property
    def angle(self) -> float:
        """Unit of the specification's angles, rad: degrees in a file by hand, radians in what MuJoCo has written."""
        return np.pi / 180 if self.spec.compiler.degree else 1.0

    @property
    def hold(self) -> int:
        """Steps for which the hooks' forces are held: hooks are slow and need no more than `HELD` s."""
        return max(1, round(HELD / self.step)) if self.hooks else 1

    @property
    def step(self) -> float:
        """Length of one step, s."""
        return self.rig.period / self.steps


@dataclass(frozen=True)
class Played:
    """Runs as they went: states of the rig's own joints at each sample (runs, T, 2 nv), clean samples (runs, T, ny)."""

    states: np.ndarray
    samples: np.ndarray


def new_world(rig: Rig, errors: np.ndarray, fine: bool) -> World:
    """The rig with its unknowns off by `errors` (p,), relative where the naive value is not zero, else in its unit.

    Fine worlds step at a tenth of the naive step or less with RK4, coarse ones as the naive model does.
    """
    spec, steps = mujoco.MjSpec.from_string(rig.xml), rig.fine if fine else rig.coarse
    spec.option.timestep = rig.period / steps
    if fine:
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for unknown, error in zip(rig.unknowns, errors, strict=True):
        _misjudge(spec, unknown.field, unknown.site, error)
    for joint in spec.joints:
        if joint.frictionloss:
            sharp_dry_friction(joint, spec.option.timestep)
    return World(rig, spec, steps, np.zeros(len(rig.channels)))


def sharp_dry_friction(joint, step: float) -> None:
    """Have dry friction turn over with the speed and hold at rest: at MuJoCo's default it turns over some 10 ms before
    the speed does, as no friction would."""
    joint.solref_friction, joint.solimp_friction = (PROMPT * step, 1.0), FIRM


def _misjudge(spec: mujoco.MjSpec, quantity: str, site: str, error: float) -> None:
    if quantity in ("damping", "armature", "frictionloss"):
        joint = spec.joint(site)
        joint.damping = joint.damping * (1 + error * np.array([quantity == "damping", 0, 0]))
        joint.armature *= 1 + error * (quantity == "armature")
        joint.frictionloss *= 1 + error * (quantity == "frictionloss")
        return
    body = spec.body(site)
    if quantity in ("mass", "inertia"):
        body.inertia = body.inertia * (1 + error)
    if quantity == "mass":
        body.mass *= 1 + error
    if quantity in AXES:
        axis = AXES.index(quantity)
        body.ipos = body.ipos + error * (body.ipos[axis] or 1.0) * np.eye(3)[axis]


def play(world: World, start: np.ndarray, ctrl: np.ndarray, push: np.ndarray | None = None, offset=0.0) -> Played:
    """Simulate runs from `start` (runs, 2 nv) under commands (runs, T, nu), each held for a sample.

    push: disturbing generalised forces per step (runs, N, nv) or None. offset: of the recorder's clock (runs,), s.
    """
    rig, model = world.rig, compiled(world)
    count = ctrl.shape[1] * world.steps + int(np.ceil(max(world.drift, 0) * ctrl.shape[1] * world.steps)) + world.steps
    drive = _pad(np.repeat(ctrl, world.steps, axis=1), count)
    for change in world.commands:
        drive = change(drive, world.step)
    force = np.zeros((len(start), count, model.nv))
    dofs = [model.joint(rig.naive.joint(j).name).dofadr[0] for j in range(rig.naive.njnt)]
    if push is not None:
        force[:, :, dofs] = _pad(push, count)
    first = _initial(model, dofs, start)
    _settle(model, world.settled, first)
    states, sensed = (_walk if world.hooks else _fly)(world, model, first, drive, force)
    keep = np.concatenate([1 + np.array(dofs), 1 + model.nq + np.array(dofs)])
    per_sample = world.steps // world.hold
    return Played(
        states[:, : ctrl.shape[1] * per_sample : per_sample, keep], _sample(world, sensed, ctrl.shape[1], offset)
    )


def compiled(world: World) -> mujoco.MjModel:
    """The model of `world`, its contacts as soft as with rigid shafts: MuJoCo scales their stiffness by the inverse
    inertia at rest, which a joint without inertia of its own would change, and with it more than what is planted."""
    model = world.spec.compile()
    if world.shafts:
        rigid = copy.copy(model)
        rigid.dof_armature[[model.joint(name).dofadr[0] for name in world.shafts]] = LOCKED
        mujoco.mj_setConst(rigid, mujoco.MjData(rigid))
        model.body_invweight0[:] = rigid.body_invweight0
    return model


def _pad(signal: np.ndarray, count: int) -> np.ndarray:
    extra = count - signal.shape[1]
    return (
        np.concatenate([signal, np.repeat(signal[:, -1:], extra, axis=1)], axis=1) if extra > 0 else signal[:, :count]
    )


def _initial(model: mujoco.MjModel, dofs: list[int], start: np.ndarray) -> np.ndarray:
    first = np.zeros((len(start), mujoco.mj_stateSize(model, FULL)))
    nv = len(dofs)
    first[:, 1 + np.array(dofs)] = start[:, :nv]
    first[:, 1 + model.nq + np.array(dofs)] = start[:, nv:]
    return first


def _settle(model: mujoco.MjModel, joints: list[str], first: np.ndarray) -> None:
    """Put springy `joints` where they hold the weight of each of the states `first`, which is changed."""
    dofs = [model.joint(name).dofadr[0] for name in joints]
    data = mujoco.MjData(model)
    for row in first if joints else ():
        for _ in range(SETTLINGS):
            mujoco.mj_setState(model, data, row, FULL)
            data.qvel[:] = 0
            mujoco.mj_forward(model, data)
            row[1 + np.array(dofs)] = -data.qfrc_bias[dofs] / model.jnt_stiffness[model.dof_jntid[dofs]]


def _fly(world, model, first, drive, force):
    """All runs in C."""
    control = np.concatenate([drive, force], axis=2)
    states, sensed = rollout.rollout(model, mujoco.MjData(model), first, control, control_spec=int(DRIVEN))
    return np.concatenate([first[:, None], states[:, :-1]], axis=1), sensed


def _walk(world, model, first, drive, force):
    """Run by run, with the hooks between steps."""
    states, sensed = np.empty((*drive.shape[:2], first.shape[1])), np.empty((*drive.shape[:2], model.nsensordata))
    for run in range(len(first)):
        data = mujoco.MjData(model)
        mujoco.mj_setState(model, data, first[run], FULL)
        hooks = [make(model, data) for make in world.hooks]
        # Asking for them takes longer than what is done with them.
        ctrl, applied, qpos, qvel, senses = data.ctrl, data.qfrc_applied, data.qpos, data.qvel, data.sensordata
        for k in range(0, drive.shape[1] - world.hold + 1, world.hold):
            ctrl[:], applied[:], own = drive[run, k], force[run, k], states[run, k]
            own[0], own[1 : 1 + model.nq], own[1 + model.nq :] = data.time, qpos, qvel
            for hook in hooks:
                hook()
            mujoco.mj_step(model, data)
            sensed[run, k] = senses  # of the step's beginning
            if world.hold > 1:
                mujoco.mj_step(model, data, world.hold - 1)
    return states[:, :: world.hold], sensed[:, :: world.hold]


def _sample(world: World, sensed: np.ndarray, samples: int, offset) -> np.ndarray:
    rig = world.rig
    clean = sensed[:, :, rig.columns]
    shifts = np.broadcast_to(offset, len(clean))[:, None] - world.delays[None]
    time = np.arange(samples) * rig.period
    if not shifts.any() and world.drift == 0:
        per_sample = world.steps // world.hold
        out = clean[:, : samples * per_sample : per_sample].copy()
    else:
        out = np.stack(
            [
                _read(run, world.step * world.hold, time * (1 + world.drift), late)
                for run, late in zip(clean, shifts, strict=True)
            ]
        )
    for change in world.senses:
        out = change(out)
    return out


def _read(clean: np.ndarray, step: float, time: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Columns of one run (N, ny) at `time` plus each column's shift; straight lines before the start.

    Forces jump with the commands, so what was simulated finely is interpolated linearly.
    """
    grid = np.arange(len(clean)) * step
    at = time[:, None] + shifts[None]
    if step <= HELD:
        read = [np.interp(at[:, j], grid, column) for j, column in enumerate(clean.T)]
    else:
        read = [CubicSpline(grid, column)(np.maximum(at[:, j], 0)) for j, column in enumerate(clean.T)]
    return np.stack(read, axis=1) + np.minimum(at, 0) * (clean[1] - clean[0]) / step
