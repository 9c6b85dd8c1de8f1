"""Servos and their firmware: gains, dead bands, coarse targets, a supply that sags, and what firmware adds unseen."""

from typing import Any

import mujoco
import numpy as np

from fimpact.effects import priors, sites, typical
from fimpact.effects.base import MOTOR, Coefficient, Effect
from fimpact.effects.drives import driven_joints, motor_force, position_servo, within
from fimpact.effects.law_inputs import Signal, State
from fimpact.effects.native import exporting

SERVO = "MuJoCo documentation, XML reference, actuator/position"
TABLE = "ROBOTIS e-Manual, control tables of AX and X series (compliance margin, goal position)"
GUESSED = "firmware counts its gains in units of its own; what models make of them is known to a third"
STEPS = (300 / 1024, 1.0)  # degrees: AX series, whole degrees; what is finer shows nowhere


def servo_kp(model, site, change):
    """The gain on the position's error; the one on speed is kept."""
    row = model.actuator(site).id
    model.actuator_gainprm[row, 0] *= 1 + change
    model.actuator_biasprm[row, :2] *= 1 + change


def servo_kv(model, site, change):
    """The gain on the speed, or on its error where the target is a speed; the one on the position's error is kept."""
    row = model.actuator(site).id
    if model.actuator_biasprm[row, 1] == 0:
        model.actuator_gainprm[row, 0] *= 1 + change
        model.actuator_biasprm[row, 0] *= 1 + change
    model.actuator_biasprm[row, 2] *= 1 + change


def deadband(state: State, site, width):
    """What the servo gives less because it counts its error from the edge of a band around the target."""
    joint, drive = position_servo(state, site)
    (dof, position, speed), bias = state.joint(joint), np.asarray(drive.bias)
    stiffness = -bias[1]
    target = within(state.ctrl[:, drive.index], drive.least, drive.most)
    error = (drive.gain * target + bias[0]) / stiffness - drive.gear * position
    felt = np.sign(error) * np.maximum(np.abs(error) - width / 2, 0.0)
    braking = bias[2] * drive.gear * speed
    given, asked = (within(stiffness * own + braking, drive.low, drive.high) for own in (felt, error))
    return state.on_joint(dof, drive.gear * (given - asked))


def target_resolution(ctrl, signal: Signal, site, step):
    """Targets are rounded to whole steps from zero."""
    out = np.array(ctrl, float)
    if step > 0:
        column = signal.actuators.index(site)
        out[:, :, column] = step * np.round(out[:, :, column] / step)
    return out


def _steps(finest, farthest):
    """Steps between which no target up to the farthest changes its place in a step by more than a quarter."""
    count = int(4 * (farthest / finest - 1))
    return farthest / (1 + np.arange(count + 1) / 4)


def supply_sag(state: State, site, droop):
    """Every motor loses the same share of its torque, up to all of it: the more, the more all of them give."""
    joints = driven_joints(state)
    forces = np.stack([motor_force(state, joint) for joint in joints])
    lost = np.minimum(droop * np.abs(forces).sum(0), 1.0)
    out = np.zeros_like(state.qvel)
    out[:, [state.joint(joint)[0] for joint in joints]] = -(lost * forces).T
    return out


def gravity_compensation(state: State, site, share):
    """A share of what holds the driven joints against gravity in the posture at hand."""
    model, data, held = state.model, state.kinematics, np.empty_like(state.qvel)
    for row, qpos in zip(held, state.qpos, strict=True):
        data.qpos[:] = qpos  # qvel is zero: what is needed is gravity's
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_rne(model, data, 0, row)
    out, dofs = np.zeros_like(held), [state.joint(joint)[0] for joint in driven_joints(state)]
    out[:, dofs] = share * held[:, dofs]
    return out


def friction_compensation(model, site, share):
    """MuJoCo's dry and viscous friction of the joint, less by a share."""
    dof = model.joint(site).dofadr[0]
    model.dof_frictionloss[dof] *= 1 - share
    model.dof_damping[dof] *= 1 - share


def _export_gravity(spec, site, share):
    """MuJoCo's gravcomp, of all bodies that driven joints carry."""
    model = spec.compile()
    moved = [int(model.joint(joint).id) for joint in sites.driven(model)]
    roots = set(model.body_rootid[model.jnt_bodyid[moved]].tolist())
    for body in spec.bodies:
        if model.body_rootid[body.id] in roots:
            body.gravcomp += share


def _compensated(scales, model, site):
    """Firmware holds an arm, and does not load it: less than nothing is what the model has too much of."""
    return {"share": (-1.5 if model.body_gravcomp.any() else 0.0, 1.5)}


def _change_probes(scales, model, site):
    return [{"change": typical.SMALL}]


GAIN: dict[str, Any] = {
    "family": "actuation",
    "reference": SERVO,
    "enters": "model",
    "probes": _change_probes,
    "neutral": {"change": 0.0},
    "prior": priors.fixed(change=0.3),
    "prior_source": GUESSED,
    "order": MOTOR,
}

EFFECTS = (
    Effect(
        name="servo_kp",
        equation="τ = (1 + ε) kp (u − q) − kv q̇",
        sentence="The servo holds its position more stiffly (or, ε < 0, less) than its gain in the model says.",
        coefficients=(Coefficient("change", "1", low=-0.9, high=9.0),),
        sites=sites.holding,
        law=servo_kp,
        export=exporting(servo_kp),
        **GAIN,
    ),
    Effect(
        name="servo_kv",
        equation="τ = kp (u − q) − (1 + ε) kv q̇;  where the target is a speed, τ = (1 + ε) kv (u − q̇)",
        sentence="The servo brakes its speed, or holds it, more (or, ε < 0, less) than its gain in the model says.",
        coefficients=(Coefficient("change", "1", low=-1.0, high=9.0),),
        sites=sites.braking,
        law=servo_kv,
        export=exporting(servo_kv),
        **GAIN,
    ),
    Effect(
        name="deadband",
        family="actuation",
        equation="τ = kp e − kv q̇,  e = 0 where |u − q| ≤ b/2, else u − q ∓ b/2",
        sentence="The servo leaves small errors of its position alone: within a band it does not pull.",
        reference=TABLE,
        enters="force",
        coefficients=(Coefficient("width", "rad", low=0.0),),
        sites=sites.direct,
        probes=lambda scales, model, site: [{"width": part * typical.target(model, site)} for part in (0.1, 0.5, 2.0)],
        law=deadband,
        neutral={"width": 0.0},
        linear=False,
        prior=priors.of_targets(width=0.5),
        prior_source="data sheets: hobby servos 1 to 10 µs of pulse, 0.1 to 1 degree; smart servos a few counts",
        order=MOTOR,
        refines=("servo_kp",),
    ),
    Effect(
        name="target_resolution",
        family="actuation",
        equation="u = s round(u_command/s)",
        sentence="The servo takes its target in steps: what is commanded between them is rounded.",
        reference=TABLE,
        enters="command",
        coefficients=(Coefficient("step", "rad", low=0.0),),
        sites=sites.direct,
        probes=lambda scales, model, site: [{"step": part * typical.target(model, site)} for part in STEPS],
        law=target_resolution,
        neutral={"step": 0.0},
        linear=False,
        scan=_steps,
        prior=priors.of_targets(step=0.3),
        prior_source="data sheets: 4096 steps per turn, 1024 in 300 degrees, or whole degrees",
        order=MOTOR,
    ),
    Effect(
        name="supply_sag",
        family="actuation",
        equation="τ = (1 − s Σ|τ_model|) τ_model, the sum over all motors at their joints",
        sentence="The voltage of battery or supply falls under load, and takes torque from every motor.",
        reference="Plett, Battery Management Systems I, Artech House 2015, ch. 2",
        enters="force",
        coefficients=(Coefficient("droop", "1/(N m)", low=0.0),),
        sites=sites.powered,
        probes=lambda scales, model, site: [{"droop": 10 * typical.SMALL * priors.droop(scales, model, site)["droop"]}],
        law=supply_sag,
        neutral={"droop": 0.0},
        prior=priors.droop,
        prior_source="batteries and supplies of small robots fall by some 10 % where all motors pull",
        order=MOTOR,
        refines=("gain", "saturation"),
    ),
    Effect(
        name="gravity_compensation",
        family="actuation",
        equation="τ = τ_logged + c g(q) at every driven joint",
        sentence="Firmware holds the arm against gravity, and the logged torque or target lacks what it adds.",
        reference="Siciliano, Sciavicco, Villani, Oriolo, Robotics, Springer 2009, ch. 8",
        enters="force",
        coefficients=(Coefficient("share", "1", low=-1.5, high=1.5),),
        sites=sites.weighed,
        probes=lambda scales, model, site: [{"share": typical.SMALL}],
        ranges=_compensated,
        law=gravity_compensation,
        neutral={"share": 0.0},
        export=_export_gravity,
        prior=priors.fixed(share=1.0),
        prior_source="firmware compensates all of an arm's weight, or none",
        order=MOTOR,
    ),
    Effect(
        name="friction_compensation",
        family="actuation",
        equation="τ = τ_logged + c (Fc sign(q̇) + d q̇), with the model's own Fc and d",
        sentence="The joint rubs less than the model says: firmware pushes along unseen, or the model has too much.",
        reference="Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994",
        enters="model",
        coefficients=(Coefficient("share", "1", low=0.0, high=1.0),),
        sites=sites.braked,
        probes=lambda scales, model, site: [{"share": typical.SMALL}],
        law=friction_compensation,
        neutral={"share": 0.0},
        export=exporting(friction_compensation),
        prior=priors.fixed(share=0.5),
        prior_source="firmware takes half to all of the friction away",
        order=MOTOR,
    ),
)
