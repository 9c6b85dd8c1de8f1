"""An edit of a body's inertia also makes what holds it softer or firmer, at contacts and at limits."""

from functools import cache
from unittest.mock import patch

import mujoco
import numpy as np
import pytest
from recorded import record, waves

from fimpact.recordings import Unknown
from fimpact.smoothing.dynamics import response as module
from fimpact.smoothing.dynamics.plant import plant_of
from fimpact.smoothing.dynamics.response import Response
from fimpact.smoothing.dynamics.softness import held_by, ratios, with_softer
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

HOPPER = """<mujoco><option timestep="0.002"/><worldbody><geom name="floor" type="plane" size="2 2 0.1"/>
<body name="hopper" pos="0 0 0.1"><joint name="rail" type="slide" axis="0 0 1"/><geom name="foot" size="0.1" mass="1"/>
<body name="mast" pos="0 0 0.1"><joint name="sway" axis="0 1 0" damping="0.05"/>
<geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02" mass="0.3" contype="0" conaffinity="0"/>
</body></body></worldbody>
<contact><pair geom1="floor" geom2="foot" solref="0.05 1" solimp="0.01 0.95 0.01"/></contact>
<actuator><motor name="lift" joint="rail"/><motor name="swing" joint="sway"/></actuator>
<sensor><jointpos name="height" joint="rail"/><jointpos name="angle" joint="sway"/></sensor></mujoco>"""
LEANING = """<mujoco><option timestep="0.002"/><worldbody><body name="rod">
<joint name="pivot" axis="0 1 0" damping="0.02" limited="true" range="-20 20" solreflimit="0.05 1"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.015" mass="0.3" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor name="motor" joint="pivot"/></actuator>
<sensor><jointpos name="angle" joint="pivot"/></sensor></mujoco>"""
PERIOD = 0.004


@cache
def response(xml: str, channels: tuple[str, ...], body: str) -> Response:
    size = [6.0, 0.05] if len(channels) == 2 else [0.8]
    runs = [waves(150, size, i, PERIOD) for i in range(2)]
    made = prepare(record(xml, channels, runs, 1e-4, unknowns=(Unknown("mass", body, 0.1),), period=PERIOD))
    found = smooth(made.track, made.begun, made.noise)
    plant = plant_of(made.track, (), found.theta, found.states, found.tau, found.doubt)
    return Response(plant, found.states, found.tau)


RIGS = {"contact": (HOPPER, ("height", "angle"), "hopper"), "limit": (LEANING, ("angle",), "rod")}


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_what_a_mass_does_where_something_holds_it_is_what_a_simulation_says(rig):
    own = response(*rig)
    theta = np.array([own.track.simulator.theta[0] * 1.02])
    heavier = plant_of(own.track, (), theta, own.states, own.tau, np.full_like(own.tau, 1e-3))
    held = own(heavier)
    with patch.object(module, "RESTING", ()):
        simulated = Response(own.plant, own.states, own.tau)
        simulated.long = True
        truly = simulated(heavier)
    n = own.track.model.nv
    push = own.slopes().advance[:, n : 2 * n, own.states.size :]
    force = np.einsum("kij,kj->ki", push, held.force)
    rows = is_held(own)
    truth = truly.after[rows, n : 2 * n]
    without, whole = force[rows] - truth, force[rows] + held.after[rows, n : 2 * n] - truth
    size = np.linalg.norm(truth, axis=0)
    assert (np.linalg.norm(whole, axis=0) < 0.25 * size).all()
    assert (np.linalg.norm(without, axis=0) > 0.8 * size).all()


def is_held(own: Response) -> np.ndarray:
    """Whether each sample, (N,), both begins and ends where something holds it: between, an edit may change when."""
    turned, model = own.states.qpos[:, 0], own.track.model
    held = np.abs(turned) > np.deg2rad(20) if model.jnt_limited.any() else turned < 0
    return held & held[np.minimum(np.arange(len(held)) + 1, len(held) - 1)] & ~own.track.last


def test_only_what_holds_something_counts():
    contact, limit = (response(*rig) for rig in RIGS.values())
    model = contact.plant.model
    places = [("body_invweight0", (model.geom(name).bodyid[0], 0)) for name in ("floor", "foot")]
    assert held_by(contact.track, model, contact.states) == places
    assert held_by(limit.track, limit.plant.model, limit.states) == [("dof_invweight0", (0,))]
    hanging = limit.states[np.abs(limit.states.qpos[:, 0]) < np.deg2rad(15)]
    assert len(hanging) and held_by(limit.track, limit.plant.model, hanging) == []


def test_what_the_world_holds_has_no_softness_of_its_own():
    model = mujoco.MjModel.from_xml_string(HOPPER)
    world, hopper = ("body_invweight0", (0, 0)), ("body_invweight0", (1, 0))
    softer, part = with_softer(model, hopper)
    assert ratios([world, hopper], softer, model) == {hopper: pytest.approx(part)}
    assert ratios([hopper], model, model) == {}
