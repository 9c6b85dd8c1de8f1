"""Parameters reach everything that follows from them, and MJX agrees with MuJoCo C."""

import dataclasses
import re

from fimpact.paper.mjx.engine import mjx

import mujoco
import numpy as np
import pytest
from conftest import CLEAR, TOUCHING

from fimpact.paper import reference_simulator
from fimpact.paper.information.programs import programs
from fimpact.paper.information.rollout import average_of_joint, with_parameters
from fimpact.paper.systems import SYSTEMS, make_system


def predict(system, rho, design):
    return programs(system).linearise(system.template, rho, design)


def test_every_parameter_changes_the_rollout_in_both_engines(system):
    design, one = TOUCHING[system.name], np.ones(len(system.nominal))
    for i in range(len(one)):
        rho = one + 0.05 * (np.arange(len(one)) == i)
        moved = predict(system, rho, design).measurement - predict(system, one, design).measurement
        in_c = (
            reference_simulator.simulate(system, rho * system.nominal, design)[0]
            - reference_simulator.simulate(system, system.nominal, design)[0]
        )
        assert np.abs(moved).max() > 1, system.parameters[i].name
        assert np.abs(in_c).max() > system.sensor.noise, system.parameters[i].name


def test_mjx_and_the_papers_sensor_agree_with_mujoco_c_and_its_own_sensor(system):
    rng = np.random.default_rng(3)
    for rho in rng.uniform(0.9, 1.1, (4, len(system.nominal))):
        measured, contact_steps = reference_simulator.simulate(system, rho * system.nominal, TOUCHING[system.name])
        predicted = predict(system, rho, TOUCHING[system.name])
        assert contact_steps > 0
        error = predicted.measurement[0] * system.sensor.noise - measured.ravel()
        assert np.abs(error).max() < 1e-6 * np.abs(measured).max()


def test_silent_without_contact(system):
    measured, contact_steps = reference_simulator.simulate(system, system.nominal, CLEAR[system.name])
    assert contact_steps == 0
    assert np.abs(measured).max() < 1e-9


def test_mjcf_holds_the_nominal_parameters_of_the_configuration(system):
    plain = dataclasses.replace(system, edit=lambda *_: None).compile(system.nominal)
    edited = system.compile(system.nominal)
    for name in ("body_mass", "body_inertia", "body_ipos", "body_pos", "geom_pos"):
        assert np.allclose(getattr(plain, name), getattr(edited, name), rtol=1e-3, atol=1e-6), name


def test_a_longer_link_moves_its_child_its_rod_and_its_mass(systems):
    arm = systems["arm"]
    longer = arm.nominal * np.array([1, 1, 1, 1.2, 1, 1])
    before, after = arm.compile(arm.nominal), arm.compile(longer)
    assert after.body("link_2").pos[0] == pytest.approx(1.2 * before.body("link_2").pos[0])
    assert after.body("link_1").ipos[0] == pytest.approx(1.2 * before.body("link_1").ipos[0])
    assert after.geom("rod_1").size[1] == pytest.approx(1.2 * before.geom("rod_1").size[1])
    assert after.body("link_1").mass == pytest.approx(before.body("link_1").mass / 1.2**2)


def test_the_mats_stiffness_does_not_depend_on_the_blocks_mass(systems):
    block = systems["block"]
    light, heavy = (block.compile(block.nominal * [scale, 1, 1]) for scale in (0.8, 1.2))
    assert light.pair_solref[0, 0] * light.body("block").mass == pytest.approx(
        heavy.pair_solref[0, 0] * heavy.body("block").mass
    )


def test_unknown_system_is_named_with_those_available():
    with pytest.raises(ValueError, match=re.escape(f"available: {', '.join(SYSTEMS)}")):
        make_system("leg", {})


def test_derived_inverse_weights_match_a_recompiled_model(system):
    theta = system.nominal * np.linspace(0.8, 1.2, len(system.nominal))
    ours, compiled = with_parameters(system, system.template, theta), system.compile(theta)
    assert np.allclose(ours.body_invweight0, compiled.body_invweight0, rtol=1e-8)
    assert np.allclose(ours.dof_invweight0, compiled.dof_invweight0, rtol=1e-8)


def test_a_free_or_ball_joints_weights_are_averages():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom type='box' size='.1 .2 .3'/>"
        "<body pos='.3 0 0'><joint type='ball'/><geom type='box' size='.3 .1 .2'/></body></body></worldbody></mujoco>"
    )
    own = average_of_joint(mjx.put_model(model))
    data, inverse = mujoco.MjData(model), np.empty((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_solveM(model, data, inverse, np.eye(model.nv))
    assert np.allclose(own @ np.diag(inverse), model.dof_invweight0)


def test_parameters_stand_in_the_order_in_which_they_are_used(system):
    table = system.settings["parameters"]
    turned = {name: table[name] for name in reversed(table)}
    assert make_system(system.name, {**system.settings, "parameters": turned}).parameters == system.parameters
    with pytest.raises(ValueError, match="allowed: all of"):
        make_system(system.name, {**system.settings, "parameters": {"colour": next(iter(table.values()))}})
