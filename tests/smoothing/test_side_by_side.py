"""What many hypotheses do along a motion, side by side, is what each of them does alone."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from recorded import record, waves

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.effects.drives import motor_force
from fimpact.effects.gears import coupled, encoders
from fimpact.effects.law_inputs import State
from fimpact.smoothing.dynamics import side_by_side
from fimpact.smoothing.dynamics.laws import Driven, acts_of, force_of, read_by
from fimpact.smoothing.dynamics.plant import plant_of
from fimpact.smoothing.dynamics.side_by_side import longest_piece
from fimpact.smoothing.dynamics.track import Step
from fimpact.smoothing.prepare import prepare

# Plain motors on rotors, a servo that saturates beside a motor, and a servo whose rotor the model does not know.
ARM = """<mujoco><option timestep="0.005"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
<body name="a"><joint name="j1" axis="0 0 1" damping="0.05" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/>
<body name="b" pos="0.3 0 0"><joint name="j2" axis="0 1 0" damping="0.05" armature="0.005"/>
<geom type="capsule" fromto="0 0 0 0.25 0 0" size="0.02" mass="0.3"/>
<body name="c" pos="0.25 0 0"><joint name="j3" axis="0 1 0" damping="0.05"/>
<geom type="capsule" fromto="0 0 0 0.15 0 0" size="0.02" mass="0.2"/></body></body></body></worldbody>
<actuator><motor name="m1" joint="j1"/>SECOND<position name="m3" joint="j3" kp="6" kv="0.1"/></actuator>
<sensor><jointpos name="q1" joint="j1"/><jointpos name="q2" joint="j2"/><jointpos name="q3" joint="j3"/>
<jointvel name="v2" joint="j2"/></sensor></mujoco>"""
MOTOR = '<motor name="m2" joint="j2" ctrllimited="true" ctrlrange="-0.8 0.8"/>'
BOTH = '<position name="m2" joint="j2" kp="9" kv="0.2" forcerange="-2 2"/><motor name="m4" joint="j2" gear="0.3"/>'
JOINTS = ("j1", "j2", "j3")


@cache
def arm(second: str):
    """Track, states, missing force and doubt: runs of one piece and of several."""
    motors = 4 if second == BOTH else 3
    commands = [waves(samples, [0.6] * motors, i) for i, samples in enumerate((130, 560, 200))]
    prepared = prepare(record(ARM.replace("SECOND", second), ("q1", "q2", "q3", "v2"), commands, 5e-4), refine=1)
    tau = 0.1 * np.random.default_rng(0).standard_normal(prepared.begun.qvel.shape)
    return prepared.track, prepared.begun, tau, np.full_like(tau, 0.01)


def gears() -> list[Placed]:
    """Plays and elasticities of all joints, one of them none."""
    found = [Placed(EFFECTS["backlash"], joint, {"gap": gap}) for joint in JOINTS for gap in (0.03, 0.0, 0.002)]
    for joint in JOINTS:
        for compliance, retardation in ((0.02, 0.01), (1e-3, 0.03), (5e-3, 2.0)):
            values = {"compliance": compliance, "retardation": retardation}
            found.append(Placed(EFFECTS["joint_elasticity"], joint, values))
    return found


def laggard(state, site, size):
    """Follows the motor half a second late: it remembers, and knows no arrays of sizes."""
    last = state.memory.get(("late", site), np.zeros(len(state.qpos)))
    late = last + 2 * state.step * (motor_force(state, site) - last)
    state.memory["late", site] = late
    return state.on_joint(state.joint(site)[0], late * float(size))


LATE = replace(EFFECTS["dahl"], name="late", law=laggard, neutral={"size": 0.0}, side_by_side=False)


def others() -> list[Placed]:
    """Laws of force and friction, with a memory and without, and laws that are neither."""
    found = [
        Placed(EFFECTS["dahl"], joint, {"friction": friction, "displacement": displacement})
        for joint in JOINTS
        for friction, displacement in ((0.1, 0.01), (0.3, 0.1), (0.1, 1.0))
    ]
    anchors = ({"anchor_x": x, "anchor_y": y, "anchor_z": 0.2} for x, y in ((1.0, 0.0), (0.0, -1.0)))
    found += [Placed(EFFECTS["cable_pull"], "c", {"stiffness": 3.0, **anchor}) for anchor in anchors]
    found += [Placed(LATE, "j1", {"size": size}) for size in (0.1, 0.2)]
    return [
        *found,
        Placed(EFFECTS["stribeck"], "j2", {"coulomb": 0.1, "excess": 0.1, "speed": 0.3}),
        Placed(EFFECTS["linear_drag"], "c", {"coefficient": 0.2}),
        Placed(EFFECTS["viscous"], "j1", {"damping": 0.2}),
        Placed(EFFECTS["sensor_bias"], "q1", {"offset": 0.1}),
    ]


@pytest.mark.parametrize("second", [MOTOR, BOTH], ids=["motor", "servo"])
@pytest.mark.parametrize("most", [2048, 12])
def test_side_by_side_is_one_by_one(second, most, monkeypatch):
    monkeypatch.setattr(side_by_side, "ABREAST", most)
    track, states, tau, doubt = arm(second)
    both = [*gears(), *others()]
    laws = both[::2] + both[1::2]

    def alone(law):
        still = np.zeros((track.count, 4))
        gear = law.effect.enters == "gear"
        return force_of(track, law, states, tau, doubt), read_by(
            track, law, states, Step(states, still)
        ).readings if gear else still

    for law, (force, read) in zip(laws, acts_of(track, laws, states, tau, doubt), strict=True):
        expected, change = alone(law)
        if law.effect.enters == "gear":
            none = alone(replace(law, values=law.effect.neutral))
            expected, change = expected - none[0], change - none[1]
            assert change.any() == (law.values.get("gap") != 0)
        assert expected.any() == (law.effect.name not in ("viscous", "sensor_bias") and law.values.get("gap") != 0)
        np.testing.assert_allclose(force, expected, atol=1e-12 * max(1, np.abs(expected).max()), err_msg=law.name)
        np.testing.assert_allclose(read, change, atol=1e-12, err_msg=law.name)


@pytest.mark.parametrize("second", [MOTOR, BOTH], ids=["motor", "servo"])
def test_a_gear_acts_as_in_a_simulation(second):
    """Asked step by step for what its motor gives, as a simulation asks."""
    track, states, tau, doubt = arm(second)
    rate = (track.next(states).qvel - states.qvel) / track.period
    rows, model = track.pieces[0], track.model
    for law in gears()[::2]:
        dof, memory, steps = int(model.joint(law.site).dofadr[0]), {}, []
        for now in rows.T:
            parts = states.qpos[now], states.qvel[now], track.ctrl[now, 0], track.time[now]
            found = coupled(model, State(model, *parts, track.period, memory), law.effect.law, law.site, law.values)
            pull = found.pull - (found.inertia - model.dof_armature[dof]) * rate[now, dof]
            steps.append(np.stack([pull, found.lead, found.rate], 1))
        pull, *leads = track.gathered(np.stack(steps, 1)).T
        force, read = force_of(track, law, states, tau, doubt), np.zeros((track.count, 4))
        for own, lead in zip(encoders(model, law.site), leads, strict=True):
            read[:, np.isin(track.simulator.columns, own)] += lead[:, None]
        scale = max(1, np.abs(pull).max())
        np.testing.assert_allclose(force[:, dof], pull, atol=1e-10 * scale, err_msg=law.name)
        np.testing.assert_allclose(
            read_by(track, law, states, Step(states, np.zeros_like(read))).readings, read, atol=1e-10
        )


def test_one_walk_for_all_gears_of_a_kind_and_one_for_the_rigid_one():
    track, states, tau, doubt = arm(MOTOR)
    asked = []

    def counted(shaft, site, gap):
        asked.append(len(shaft.torque))
        return EFFECTS["backlash"].law(shaft, site, gap)

    effect, pieces = replace(EFFECTS["backlash"], law=counted), len(track.pieces[0])
    laws = [Placed(effect, joint, {"gap": gap}) for joint in ("j1", "j2") for gap in (0.01, 0.02, 0.03)]
    acts_of(track, laws, states, tau, doubt)
    walk = longest_piece(track)
    assert asked == [6 * pieces] * walk + [2 * pieces] * walk
    asked.clear()
    force_of(track, laws[0], states, tau, doubt)
    read_by(track, laws[0], states, Step(states, np.zeros((track.count, 4))))
    assert asked == [pieces] * walk
    force_of(track, laws[1], states, tau, doubt)
    force_of(track, laws[1], replace(states), tau, doubt)
    assert asked == [pieces] * walk * 3


@pytest.mark.parametrize(
    ("beside", "at"),
    [("rotor_inertia", "j2"), ("gain", "m2"), ("command_delay", "m2")],
)
def test_a_gear_is_driven_by_what_was_found_beside_it(beside, at):
    """By the rotor, the motor and the commands of the hypothesis, not by those of the naive model."""
    track, states, tau, doubt = arm(MOTOR)
    size = {"rotor_inertia": {"inertia": 0.02}, "gain": {"change": 0.2}, "command_delay": {"delay": 0.01}}[beside]
    gear, found = Placed(EFFECTS["backlash"], "j2", {"gap": 0.03}), Placed(EFFECTS[beside], at, size)
    plant = plant_of(track, [found, gear], track.simulator.theta, states, tau, doubt)
    still = np.zeros((track.count, 4))
    told = force_of(track, gear, states, tau, doubt, plant.driven)
    np.testing.assert_allclose(plant.force, told, atol=1e-12)
    naive = force_of(track, gear, states, tau, doubt, Driven(track.model, track.ctrl[:, 0]))
    assert np.abs(told - naive).max() > 1e-3
    read = [read_by(track, gear, states, Step(states, still), 0.0, own).readings for own in (plant.driven, None)]
    assert np.abs(read[0] - read[1]).max() > 1e-3
