"""A force held over a short sample is the simulated change, and derivatives are kept while they hold."""

import copy
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from unittest.mock import patch

import mujoco
import numpy as np
import pytest
from recorded import ARM, ROD, record, waves

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.recordings import Unknown
from fimpact.smoothing.dynamics import response as module
from fimpact.smoothing.dynamics.plant import plant_of
from fimpact.smoothing.dynamics.response import NUDGE, Change, Response, Slopes
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth


def test_a_push_that_must_be_simulated_moves_a_joint_as_the_missing_force_does():
    """At another time step than derivatives it would look like a push that drifts, on a leg that stands."""
    servo = ROD.replace('<motor name="motor" joint="pivot"/>', '<position name="s" joint="pivot" kp="60" kv="0.3"/>')
    made = prepare(record(servo, ("angle",), [waves(60, [0.5], 0)], 1e-3), refine=4)
    found, push = made.naive, 0.1
    own = found.linear.response
    placed = Placed(EFFECTS["torque_offset"], "s", {"offset": push})
    plant = plant_of(made.track, (placed,), found.theta, found.states, found.tau, found.doubt)
    change = own(plant)
    assert own.simulated and not change.force.any()
    n = found.states.size
    np.testing.assert_allclose(change.after, push * found.linear.slopes.advance[:, :, n], rtol=1e-3, atol=1e-9)


@cache
def response() -> Response:
    """Along a smoothed arm, where a joint's speed lasts for far longer than a sample."""
    unknowns = (Unknown("mass", "upper", 0.1), Unknown("mass", "lower", 0.1))
    made = prepare(record(ARM, ("q1", "q2"), [waves(100, [0.3, 0.05], i) for i in range(2)], 5e-4, unknowns=unknowns))
    found = smooth(made.track, made.begun, made.noise)
    assert not found.linear.response.long
    theta, tau = found.theta, found.tau
    return Response(plant_of(made.track, (), theta, found.states, tau, found.doubt), found.states, tau)


def plant(laws=(), factor=(1.0, 1.0)):
    own = response()
    theta = np.array([0.5, 0.3]) * factor
    return plant_of(own.track, laws, theta, own.states, own.tau, np.full_like(own.tau, 1e-3))


def changed(**kinds) -> tuple[Change, Change]:
    """What a change of the plant does, as a force and simulated."""
    before, after = plant(), plant(**kinds)
    held, simulated = (Response(before, response().states, response().tau) for _ in range(2))
    simulated.long = True
    with patch.object(module, "RESTING", ()):
        return held(after), simulated(after)


def law(effect: str, site: str, **values) -> dict:
    return {"laws": (Placed(EFFECTS[effect], site, values),)}


@pytest.mark.parametrize(
    "kinds",
    [
        law("viscous", "elbow", damping=0.01),
        law("viscous", "shoulder", damping=0.01),
        law("rotor_inertia", "elbow", inertia=3e-5),
        law("rotor_inertia", "shoulder", inertia=2e-4),
        law("gravity_scale", "world", change=0.02),
        law("gain", "m1", change=0.05),
        {"factor": (1.03, 1.0)},
        {"factor": (1.0, 1.03)},
    ],
    ids=["viscous elbow", "viscous shoulder", "rotor elbow", "rotor shoulder", "gravity", "gain", "upper", "lower"],
)
def test_a_force_held_over_a_short_sample_is_the_simulated_change(kinds):
    held, simulated = changed(**kinds)
    track, slopes = response().track, slopes_of_response()
    n, rows = response().states.size, ~track.last
    assert held.force.any() and not held.after.any()
    assert simulated.after.any() and not simulated.force.any()
    after = np.einsum("kij,kj->ki", slopes.advance[:, :, n:], held.force)
    for part in (slice(0, 2), slice(2, 4)):  # of the place and of the speed
        expected = simulated.after[rows, part]
        np.testing.assert_allclose(after[rows, part], expected, atol=0.06 * np.abs(expected).max())


@cache
def slopes_of_response() -> Slopes:
    return response().slopes()


def test_derivatives_by_state_and_force_are_those_of_the_simulation():
    own, slopes = response(), slopes_of_response()
    track, step = own.track, 1e-3
    n, nv = own.states.size, track.model.nv
    rng = np.random.default_rng(0)
    shift, push = step * rng.standard_normal((track.count, n)), 0.01 * rng.standard_normal((track.count, nv))
    found = own.plant.step(track.space.plus(own.states, shift), own.tau + push)
    expected = track.space.minus(found.after, own.near.after)
    told = np.einsum("kij,kj->ki", slopes.advance, np.concatenate([shift, push], 1))
    np.testing.assert_allclose(told, expected, atol=0.02 * np.abs(expected).max())
    read = np.einsum("kij,kj->ki", slopes.reads, np.concatenate([shift, push], 1))
    np.testing.assert_allclose(read, found.readings - own.near.readings, atol=10 * NUDGE)


def test_what_a_sensor_reads_otherwise_is_no_force():
    held, simulated = changed(**law("sensor_bias", "q2", offset=0.01))
    assert not held.force.any() and not held.after.any()
    np.testing.assert_allclose(held.readings, np.tile([0.0, 0.01], (len(held.readings), 1)), atol=1e-12)
    np.testing.assert_allclose(simulated.readings, held.readings, atol=1e-12)


def test_commands_that_are_changed_are_simulated():
    before = plant()
    own = Response(before, response().states, response().tau)
    found = own(replace(before, ctrl=replace(before.ctrl, values=before.ctrl.values + 0.1)))
    assert found.after.any() and not found.force.any()


EDITS = {
    "dof_damping": lambda model, factor: model.dof_damping.__imul__(factor),
    "body_mass": lambda model, factor: model.body_mass.__imul__(factor),
    "actuator_gainprm": lambda model, factor: model.actuator_gainprm.__imul__(factor),
    "geom_friction": lambda model, factor: model.geom_friction.__imul__(factor),
}


@pytest.mark.parametrize("edit", EDITS.values(), ids=EDITS)
@pytest.mark.parametrize(("factor", "hold"), [(1.0, True), (1.15, True), (0.85, True), (1.3, False), (0.7, False)])
def test_derivatives_are_renewed_where_the_model_has_changed_by_a_fifth(edit, factor, hold):
    model = mujoco.MjModel.from_xml_string(ROD)
    other, none = copy.copy(model), np.zeros((1, 1, 1))
    edit(other, factor)
    assert Slopes(none, none, rigid(model)).hold(rigid(other)) == hold


def test_derivatives_are_renewed_where_there_was_nothing_or_gravity_is_another():
    model = mujoco.MjModel.from_xml_string(ROD)
    sprung, leaning, none = copy.copy(model), copy.copy(model), np.zeros((1, 1, 1))
    sprung.jnt_stiffness[0] = 1e-9
    leaning.opt.gravity[0] = 1e-9
    assert not Slopes(none, none, rigid(model)).hold(rigid(sprung))
    assert not Slopes(none, none, rigid(model)).hold(rigid(leaning))


@pytest.mark.parametrize(("site", "factor", "hold"), [("j", 1.0, True), ("j", 1.15, False), ("k", 1.0, False)])
def test_derivatives_are_renewed_where_a_gear_gives_otherwise(site, factor, hold):
    model, none = mujoco.MjModel.from_xml_string(ROD), np.zeros((1, 1, 1))
    one, other = (
        SimpleNamespace(model=model, rotors=(Placed(EFFECTS["backlash"], at, {"gap": gap}),))
        for at, gap in (("j", 0.01), (site, 0.01 * factor))
    )
    assert Slopes(none, none, one).hold(other) == hold
    assert not Slopes(none, none, rigid(model)).hold(one)


def rigid(model: mujoco.MjModel) -> SimpleNamespace:
    """A plant without gears that give."""
    return SimpleNamespace(model=model, rotors=())
