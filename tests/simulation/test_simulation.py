"""Forward simulation: by MuJoCo's own steps, with exact dry friction, from starts that the measurements show."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from fimpact.benchmark.comparators.random_features import learn_force
from fimpact.deciding import ASTRAY
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.recordings import Recording, Run, Unknown
from fimpact.simulation import window_fit
from fimpact.simulation.horizon import HorizonErrors, errors_of, windows_of
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.nonsmooth import make_friction_exact
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.state_guess import measured_motion, noise_level
from fimpact.simulation.window_fit import Starts, fit_windows, refit, states_of, step_error, window_starts
from fimpact.simulation.windows import cut

ROD = """<mujoco><option timestep="0.002"/><worldbody><body name="rod">
<joint name="pivot" axis="0 1 0" damping="0.01"/>
<geom name="bar" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.015" mass="0.3" contype="0" conaffinity="0"/>
</body></worldbody>
<actuator><motor name="motor" joint="pivot"/></actuator>
<sensor><jointpos name="angle" joint="pivot"/><jointvel name="speed" joint="pivot"/>
<jointactuatorfrc name="torque" joint="pivot"/></sensor></mujoco>"""
SERVO = """<mujoco><option timestep="0.002"/><worldbody><body name="rod">
<joint name="pivot" axis="0 1 0" damping="0.05"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.015" mass="0.3"/></body></worldbody>
<actuator><position name="servo" joint="pivot" kp="4" timeconst="0.05"/></actuator>
<sensor><jointpos name="angle" joint="pivot"/></sensor></mujoco>"""
CUBE = """<mujoco><option timestep="0.002"/><worldbody><body name="cube"><freejoint/>
<inertial pos="0.01 0.02 0" mass="1" diaginertia="0.01 0.02 0.03" quat="0.9 0.1 0.3 0.2"/>
<geom type="box" size="0.1 0.1 0.1"/></body></worldbody>
<sensor><framepos name="place" objtype="{kind}" objname="cube"/>
<framequat name="turn" objtype="{kind}" objname="cube"/></sensor></mujoco>"""
PERIOD = 0.01


def recording(xml: str, channels: tuple[str, ...], *runs: Run, unknowns=()) -> Recording:
    nv = mujoco.MjModel.from_xml_string(xml).nv
    return Recording(
        xml, ".", PERIOD, channels, runs, unknowns, np.full(len(channels), 1e-3), np.full(2 * nv, np.inf), 0.0
    )


def wave(samples: int, size: float = 0.3) -> np.ndarray:
    return size * np.sin(2 * np.pi * 1.3 * PERIOD * np.arange(samples))[:, None]


def blank(samples: int, channels: int, size: float = 0.3) -> Run:
    return Run("run", wave(samples, size), np.zeros((samples, channels)), False)


def plain_rollout(model: mujoco.MjModel, ctrl, qpos, qvel, act=(), substeps: int = 5) -> np.ndarray:
    """All sensors at every sample, by MuJoCo's own loop."""
    data, rows = mujoco.MjData(model), []
    data.qpos[:], data.qvel[:], data.act[:] = qpos, qvel, act
    for u in ctrl:
        for k in range(substeps):
            data.ctrl[:] = u
            mujoco.mj_step(model, data)
            if k == 0:
                rows.append(data.sensordata.copy())
    return np.array(rows)


def test_prediction_is_that_of_plain_mujoco():
    given = recording(ROD, ("angle", "torque"), blank(60, 2))
    simulator, windows = Simulator(given), cut(given.runs, 0)
    found = simulator.predict(Hypothesis(simulator.theta), windows, np.array([[0.4]]), np.array([[1.0]]))
    expected = plain_rollout(mujoco.MjModel.from_xml_string(ROD), given.runs[0].ctrl, 0.4, 1.0)
    np.testing.assert_allclose(found[0], expected[:, [0, 2]], atol=1e-10)


def test_the_state_of_a_servo_filter_is_simulated_from_where_it_is_set():
    given = recording(SERVO, ("angle",), blank(60, 1))
    simulator, windows = Simulator(given), cut(given.runs, 0)
    hypothesis, start = Hypothesis(simulator.theta), (np.array([[0.1]]), np.zeros((1, 1)))
    model = mujoco.MjModel.from_xml_string(SERVO)
    for act in (0.0, 0.4):
        expected = plain_rollout(model, given.runs[0].ctrl, 0.1, 0.0, [act])
        found = simulator.predict(hypothesis, windows, *start, np.array([[act]]))
        np.testing.assert_allclose(found[0], expected, atol=1e-10)
    assert np.abs(simulator.predict(hypothesis, windows, *start)[0] - expected).max() > 0.01


def test_one_sample_ahead_is_a_sample_of_plain_mujoco_with_sensors_at_its_start():
    given = recording(ROD, ("torque", "speed", "angle"), blank(2, 3))
    simulator, rng = Simulator(given), np.random.default_rng(0)
    qpos, qvel, ctrl, force = (rng.standard_normal((7, 1)) for _ in range(4))
    none, model = np.zeros((7, 0)), simulator.model(Hypothesis(simulator.theta))
    q, v, act, sensed = simulator.advance(model, qpos, qvel, none, ctrl, force)
    np.testing.assert_allclose(sensed, np.concatenate([ctrl, qvel, qpos], 1), atol=1e-12)
    data = mujoco.MjData(model)
    for row in range(7):
        data.qpos[:], data.qvel[:], data.ctrl[:], data.qfrc_applied[:] = qpos[row], qvel[row], ctrl[row], force[row]
        mujoco.mj_step(model, data, nstep=simulator.substeps)
        np.testing.assert_allclose([q[row], v[row]], [data.qpos, data.qvel], atol=1e-12)
    assert act.shape == (7, 0)
    steps = np.repeat(ctrl[:, None], simulator.substeps, 1)
    steps[:, -1] += 1.0
    later = simulator.advance(model, qpos, qvel, none, steps, force)
    assert np.all(later[1] > v + 1e-3)
    np.testing.assert_array_equal(later[3], sensed)


def test_one_sample_ahead_carries_actuator_states():
    given = recording(SERVO, ("angle",), blank(2, 1))
    simulator = Simulator(given)
    model = simulator.model(Hypothesis(simulator.theta))
    act = simulator.advance(model, *np.zeros((3, 1, 1)), np.full((1, 1), 0.3), np.zeros((1, 1)))[2]
    data = mujoco.MjData(model)
    data.ctrl[:] = 0.3
    mujoco.mj_step(model, data, nstep=simulator.substeps)
    assert act[0, 0] == pytest.approx(data.act[0], rel=1e-9) and act[0, 0] > 0.04


def test_contact_is_simulated_although_a_solver_is_left_out_where_nothing_can_touch():
    xml = """<mujoco><worldbody><geom type="plane" size="1 1 .1"/>
    <body name="ball" pos="0 0 .1"><freejoint/><geom size=".1"/></body></worldbody>
    <sensor><framepos name="place" objtype="xbody" objname="ball"/></sensor></mujoco>"""
    given = recording(xml, ("place[2]",), Run("run", np.zeros((50, 0)), np.zeros((50, 1)), False))
    simulator = Simulator(given)
    start = mujoco.MjModel.from_xml_string(xml).qpos0[None]
    height = simulator.predict(Hypothesis(simulator.theta), cut(given.runs, 0), start, np.zeros((1, 6)))
    assert height[0, -1, 0] > 0.09


def exact_friction(friction: float, ctrl, qpos: float, step: float = 1e-5) -> np.ndarray:
    """Angles at every sample of the rod with friction against the sign of its speed, which also holds it at rest."""
    model = mujoco.MjModel.from_xml_string(ROD)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia, weight, v, out = 1 / model.dof_invweight0[0], 0.3 * 9.81 * 0.2, 0.0, []
    for u in ctrl[:, 0]:
        out.append(qpos)
        for _ in range(round(PERIOD / step)):
            free = v + step * (u - weight * np.sin(qpos) - 0.01 * v) / inertia
            v = np.sign(free) * max(abs(free) - step * friction / inertia, 0.0)
            qpos += step * v
    return np.array(out)


def test_added_dry_friction_is_exact_and_mujoco_s_own_is_not():
    friction, ctrl, start = 0.16, wave(300, 0.2), np.array([[0.5]])
    reference = exact_friction(friction, ctrl, 0.5)
    assert (np.diff(reference[-100:]) == 0).sum() > 3  # it sticks now and then
    given = recording(ROD, ("angle",), Run("run", ctrl, np.zeros((300, 1)), False))
    simulator, windows = Simulator(given, refine=4), cut(given.runs, 0)
    placed = Placed(EFFECTS["coulomb"], "pivot", {"friction": friction})
    hypothesis = Hypothesis(simulator.theta, (placed,))
    found = simulator.predict(hypothesis, windows, start, np.zeros((1, 1)))[0, :, 0]
    soft = simulator.model(Hypothesis(simulator.theta))
    soft.dof_frictionloss[:] = friction
    data = mujoco.MjData(soft)
    data.qpos[:] = 0.5
    default = plain_rollout(soft, ctrl, 0.5, 0.0, substeps=simulator.substeps)[:, 0]
    tight, loose = np.abs(found - reference).max(), np.abs(default - reference).max()
    assert tight < 0.002 and loose > 10 * tight, (tight, loose)


def test_a_law_of_friction_is_exact_too():
    friction, ctrl, start = 0.08, wave(200, 0.2), np.array([[0.5]])
    given = recording(ROD, ("angle",), Run("run", ctrl, np.zeros((200, 1)), False))
    simulator, windows = Simulator(given), cut(given.runs, 0)
    law = Placed(EFFECTS["stribeck"], "pivot", {"coulomb": friction, "excess": 0.0, "speed": 1.0})
    field = Placed(EFFECTS["coulomb"], "pivot", {"friction": friction})
    found, expected = (
        simulator.predict(Hypothesis(simulator.theta, (p,)), windows, start, np.zeros((1, 1))) for p in (law, field)
    )
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_friction_that_is_added_to_friction_changes_nothing_at_once():
    model = mujoco.MjModel.from_xml_string(ROD.replace("damping=", 'frictionloss="0.05" damping='))
    own = copy.copy(model)
    assert make_friction_exact(model, own) == []
    model.dof_frictionloss[0] += 1e-9
    assert make_friction_exact(model, own) == [0]
    np.testing.assert_allclose(model.dof_solref, own.dof_solref, rtol=1e-6)
    model.dof_frictionloss[0] = 1e6
    make_friction_exact(model, own)
    assert model.dof_solref[0, 0] == pytest.approx(2 * model.opt.timestep, rel=0.01)


@pytest.mark.parametrize("name", ["dahl", "backlash", "efficiency"])
def test_laws_of_many_windows_are_those_of_each_alone(name):
    xml = ROD.replace("damping=", 'armature="0.003" damping=')
    values = {
        "dahl": {"friction": 0.05, "displacement": 0.05},
        "backlash": {"gap": 0.05},
        "efficiency": {"driving": 0.2, "driven": 0.4},
    }
    given = recording(xml, ("angle", "torque"), blank(80, 2))
    simulator, windows = Simulator(given), cut(given.runs, 20)
    hypothesis = Hypothesis(simulator.theta, (Placed(EFFECTS[name], "pivot", values[name]),))
    rng = np.random.default_rng(0)
    qpos, qvel = rng.standard_normal((2, 4, 1))
    together = simulator.predict(hypothesis, windows, qpos, qvel)
    alone = [simulator.predict(hypothesis, windows.part([i]), qpos[[i]], qvel[[i]])[0] for i in range(4)]
    np.testing.assert_allclose(together, alone, atol=1e-12)
    plain = simulator.predict(Hypothesis(simulator.theta), windows, qpos, qvel)
    assert np.abs(together - plain).max() > 1e-3
    np.testing.assert_allclose(
        simulator.predict(Hypothesis(simulator.theta), windows, qpos, qvel), plain, atol=0
    )  # nothing of the law is left


def test_what_one_law_wrote_into_models_is_not_left_to_the_next():
    given = recording(ROD.replace("damping=", 'armature="0.003" damping='), ("angle",), blank(60, 1))
    windows, start = cut(given.runs, 20), (np.full((3, 1), 0.5), np.ones((3, 1)))
    used, fresh = Simulator(given), Simulator(given)
    gap = Placed(EFFECTS["backlash"], "pivot", {"gap": 0.05})
    loss = Placed(EFFECTS["efficiency"], "pivot", {"driving": 0.2, "driven": 0.4})
    for first, second in ((gap, loss), (loss, gap)):
        used.predict(Hypothesis(used.theta, (first,)), windows, *start)
        after = used.predict(Hypothesis(used.theta, (second,)), windows, *start)
        np.testing.assert_array_equal(after, fresh.predict(Hypothesis(used.theta, (second,)), windows, *start))
        fresh = Simulator(given)


def test_unknowns_and_effects_move_the_model_and_delays_what_is_read():
    given = recording(ROD, ("angle",), blank(60, 1), unknowns=(Unknown("mass", "rod"), Unknown("damping", "pivot")))
    simulator, windows = Simulator(given), cut(given.runs, 0)
    np.testing.assert_allclose(simulator.theta, [0.3, 0.01])
    model = simulator.model(Hypothesis(np.array([0.5, 0.2])))
    assert model.body("rod").mass[0] == 0.5 and model.dof_damping[0] == 0.2
    late = Placed(EFFECTS["sensor_delay"], "angle", {"delay": PERIOD})
    start = np.array([[0.4]]), np.array([[1.0]])
    plain = simulator.predict(Hypothesis(simulator.theta), windows, *start)[0, :, 0]
    found = simulator.predict(Hypothesis(simulator.theta, (late,)), windows, *start)[0, :, 0]
    np.testing.assert_allclose(found[1:], plain[:-1], atol=1e-9)
    assert found[0] == pytest.approx(2 * plain[0] - plain[1], abs=1e-9)  # straight on into the past


def test_windows_are_cut_and_spread_over_runs():
    runs = [replace(blank(n, 1), name=str(n)) for n in (100, 45)]
    runs[1].measured[20:40] = np.nan
    windows = cut(runs, 20)
    assert windows.runs.tolist() == [0] * 5 + [1] and windows.first.tolist() == [0, 20, 40, 60, 80, 0]
    few = cut(runs, 10, 4)
    assert len(few.runs) <= 4 and {0, 1} >= set(few.runs)
    np.testing.assert_array_equal(windows.part(np.array([5, 5])).first, [0, 0])


def test_noise_is_read_off_the_samples():
    rng, time = np.random.default_rng(0), PERIOD * np.arange(2000)
    slow = np.full(2000, np.nan)
    slow[::4] = np.sin(3 * time[::4]) + 0.02 * rng.standard_normal(500)
    coarse = np.round(np.sin(3 * time) / 0.05) * 0.05
    measured = np.stack([np.sin(3 * time) + 0.01 * rng.standard_normal(2000), slow, coarse], 1)
    given = recording(ROD, ("angle", "speed", "torque"), Run("run", wave(2000), measured, False))
    level = noise_level(replace(given, noise=np.full(3, np.nan)))
    np.testing.assert_allclose(level[:2], [0.01, 0.02], rtol=0.15)
    assert level[2] >= 0.05 / np.sqrt(12) - 1e-12
    assert noise_level(replace(given, noise=np.array([0.5, np.nan, 0.7])))[0] == 0.5
    still = replace(given, runs=(replace(given.runs[0], measured=np.zeros((2000, 3))),), noise=np.full(3, np.nan))
    with pytest.raises(ValueError, match="declare its `noise`"):
        noise_level(still)


def test_a_motion_is_read_off_positions_and_speeds_with_gaps():
    time, rng = PERIOD * np.arange(300), np.random.default_rng(0)
    angle, speed = np.sin(4 * time), 4 * np.cos(4 * time)
    seen = angle + 1e-3 * rng.standard_normal(300)
    seen[50:53] = np.nan
    model = mujoco.MjModel.from_xml_string(ROD)
    run = Run("run", wave(300), seen[:, None], False)
    qpos, qvel, known = measured_motion(model, recording(ROD, ("angle",), run), run)
    assert known.tolist() == [True]
    assert np.abs(qpos[:, 0] - angle).max() < 4e-3 and np.sqrt(np.mean((qvel[:, 0] - speed)[5:-5] ** 2)) < 0.1
    rate = replace(run, measured=(speed + 1e-3 * rng.standard_normal(300))[:, None], qpos=np.array([0.3]))
    qpos, qvel, known = measured_motion(model, recording(ROD, ("speed",), rate), rate)
    assert known.all() and np.abs(qpos[:, 0] - 0.3 - angle).max() < 5e-3 and np.abs(qvel[:, 0] - speed).max() < 5e-3
    torque = replace(rate, measured=np.ones((300, 1)))
    qpos, qvel, known = measured_motion(model, recording(ROD, ("torque",), torque), torque)
    assert not known.any() and np.all(qpos == 0.3) and not qvel.any()


@pytest.mark.parametrize("kind", ["xbody", "body"])
def test_the_motion_of_a_free_body_is_read_off_its_pose(kind):
    xml = CUBE.format(kind=kind)
    model = mujoco.MjModel.from_xml_string(xml)
    data, rows, states = mujoco.MjData(model), [], []
    data.qvel[:] = 0.5, 0.2, 3.0, 2.0, -5.0, 4.0
    for k in range(500):
        mujoco.mj_step1(model, data)
        if k % 5 == 0:
            rows.append(data.sensordata.copy())
            states.append(np.concatenate([data.qpos, data.qvel]))
        mujoco.mj_step2(model, data)
    measured, states = np.array(rows) + 1e-4 * np.random.default_rng(0).standard_normal((100, 7)), np.array(states)
    measured[30:, 3:] *= -1  # the same rotation
    run = Run("toss", np.zeros((100, 0)), measured, False)
    channels = tuple(f"place[{i}]" for i in range(3)) + tuple(f"turn[{i}]" for i in range(4))
    given = replace(recording(xml, channels, run), noise=np.full(7, 1e-4))
    qpos, qvel, known = measured_motion(model, given, run)
    assert known.all()
    sign = np.sign((qpos[:, 3:] * states[:, 3:7]).sum(1, keepdims=True))
    np.testing.assert_allclose(qpos[:, :3], states[:, :3], atol=1e-3)
    np.testing.assert_allclose(sign * qpos[:, 3:], states[:, 3:7], atol=1e-3)
    np.testing.assert_allclose(qvel[5:-5], states[5:-5, 7:], atol=0.1)


def record(friction: float, samples: int = 200) -> tuple[Recording, list[Starts]]:
    """Two runs of a rod with viscous friction that its model lacks, and the true states of both."""
    rng, runs, starts = np.random.default_rng(0), [], []
    given = recording(ROD, ("angle",), blank(samples, 1))
    truth = Simulator(given)
    hypothesis = Hypothesis(truth.theta, (Placed(EFFECTS["viscous"], "pivot", {"damping": friction}),))
    for number in range(2):
        start, ctrl = rng.uniform(-1, 1, (1, 1)), wave(samples, 0.2 + 0.1 * number)
        run = Run(f"run {number}", ctrl, np.zeros((samples, 1)), True)
        both = replace(given, channels=("angle", "speed"))
        whole = Simulator(both).predict(hypothesis, cut([run], 0), start, np.zeros((1, 1)))[0]
        measured = whole[:, :1] + 1e-3 * rng.standard_normal((samples, 1))
        runs.append(replace(run, measured=measured))
        starts.append(Starts(whole[:, :1], whole[:, 1:], np.zeros((samples, 0)), np.full((samples, 2), 0.05)))
    return replace(given, runs=tuple(runs)), starts


def test_starts_are_found_on_the_measurements_of_each_window():
    given, starts = record(0.02)
    simulator, windows, rng = Simulator(given), cut(given.runs, 50), np.random.default_rng(1)
    hypothesis = Hypothesis(simulator.theta, (Placed(EFFECTS["viscous"], "pivot", {"damping": 0.02}),))
    true = np.array(
        [[starts[r].qpos[k, 0], starts[r].qvel[k, 0]] for r, k in zip(windows.runs, windows.first, strict=True)]
    )
    off = true + 0.05 * rng.standard_normal(true.shape)
    near = Starts(off[:, :1], off[:, 1:], np.zeros((len(off), 0)), np.full(off.shape, 0.05))
    known = replace(near, sd=near.sd * 1e-6)
    found, sure = (
        states_of(fit_windows(simulator, hypothesis, windows, own, np.array([1e-3])), simulator)
        for own in (near, known)
    )
    assert np.abs(found[0] - true[:, :1]).max() < 1e-3 and np.abs(found[1] - true[:, 1:]).max() < 1e-2
    np.testing.assert_allclose(sure[0], off[:, :1], atol=1e-5)  # what is known is kept


def test_a_wrong_model_buys_no_start_that_nobody_has_seen():
    given, starts = record(0.2)
    simulator, windows, noise = Simulator(given), cut(given.runs, 200), np.array([1e-3])
    own = replace(window_starts(windows, starts), sd=np.full((len(windows.first), 2), 0.005))
    fit = fit_windows(simulator, Hypothesis(simulator.theta), windows, own, noise)
    far = np.sqrt(np.mean((fit.change / own.sd) ** 2, axis=1))
    assert np.all(far < 1.001 * ASTRAY) and far.max() > 0.9 * ASTRAY  # it would go on
    assert np.all((fit.left**2).sum(1) > 100 * fit.left.shape[1])  # and is seen to be wrong


@pytest.mark.parametrize("stiff", [True, False])
def test_what_a_servo_forgets_is_not_simulated(stiff, monkeypatch):
    """A start whose trace has died away in an eighth of a window is followed no further; a free rod's never has."""
    servo = '<position name="motor" joint="pivot" kp="200" kv="4"/>'
    xml = ROD.replace('<motor name="motor" joint="pivot"/>', servo) if stiff else ROD
    given = recording(xml, ("angle",), Run("run", wave(400), np.zeros((400, 1)), True))
    simulator, windows = Simulator(given), cut(given.runs, 0)
    hypothesis, noise, begun = Hypothesis(simulator.theta), np.array([1e-3]), np.zeros((1, 1))
    own = Starts(begun, begun, np.zeros((1, 0)), np.full((1, 2), 0.01))
    asked, truly = [], simulator.predict
    monkeypatch.setattr(
        simulator, "predict", lambda h, w, *s: asked.append((len(w.first), w.length)) or truly(h, w, *s)
    )
    fit = fit_windows(simulator, hypothesis, windows, own, noise)
    assert ((2, 400) not in asked) == stiff
    monkeypatch.setattr(window_fit, "SOON", 400)
    whole = fit_windows(simulator, hypothesis, windows, own, noise)
    np.testing.assert_allclose(fit.slopes * 0.01, whole.slopes * 0.01, atol=1e-3)


def test_a_finer_step_needs_no_new_slopes(monkeypatch):
    given, starts = record(0.02)
    coarse, fine, noise = Simulator(given), Simulator(given, 4), np.array([1e-3])
    windows, hypothesis = cut(given.runs, 100), Hypothesis(coarse.theta)
    own = window_starts(windows, starts)
    anew, begun = (fit_windows(plant, hypothesis, windows, own, noise) for plant in (fine, coarse))
    moved = step_error(begun, Simulator(given, 2), hypothesis, 4)
    assert 0 < moved < 1 and step_error(begun, coarse, hypothesis, 4) == 0
    monkeypatch.setattr(window_fit, "with_slopes", lambda *_: pytest.fail("slopes are kept"))
    found = refit(begun, fine, hypothesis)
    np.testing.assert_allclose(found.cost, anew.cost, rtol=0.02)
    np.testing.assert_allclose(found.predicted, anew.predicted, atol=2e-3)


def errors(simulator: Simulator, hypothesis: Hypothesis, given: Recording, starts, horizons) -> HorizonErrors:
    noise, cuts = np.array([1e-3]), windows_of(given, given.runs, horizons)
    fits = [fit_windows(simulator, hypothesis, own, window_starts(own, starts), noise) for own in cuts]
    return errors_of(fits, given.period)


def test_errors_by_horizon_are_noise_for_the_true_model_and_grow_for_a_wrong_one():
    given, starts = record(0.02)
    simulator = Simulator(given)
    right = Hypothesis(simulator.theta, (Placed(EFFECTS["viscous"], "pivot", {"damping": 0.02}),))
    horizons = [0.1, 0.2, 0.5, 1.0, 2.0]
    best, naive = (errors(simulator, h, given, starts, horizons) for h in (right, Hypothesis(simulator.theta)))
    np.testing.assert_allclose(best.horizons, horizons)
    assert best.error.shape == (5, 2, 1) and np.all(np.abs(best.normalised - 1) < 0.25)
    assert np.all(naive.normalised[-1] > 5) and np.all(naive.normalised[-1] > 2 * naive.normalised[0])
    np.testing.assert_allclose(naive.error[..., 0], naive.normalised * 1e-3)


def test_a_simulation_that_diverges_has_an_infinite_error():
    given, starts = record(0.02)
    simulator = Simulator(given)
    effect = replace(EFFECTS["quadratic_drag"], law=lambda state, site, **values: 1e9 * state.qvel**3)
    wild = Hypothesis(simulator.theta, (Placed(effect, "rod", {}),))
    found = errors(simulator, wild, given, starts, [2.0])
    assert np.isinf(found.error).all() and np.isinf(found.normalised).all()


def test_a_missing_force_is_learned_and_simulated():
    given, starts = record(0.05)
    simulator = Simulator(given)
    ctrl = np.concatenate([run.ctrl for run in given.runs])
    qvel = np.concatenate([own.qvel for own in starts])
    inputs = np.concatenate([np.concatenate([own.qpos for own in starts]), qvel, ctrl], 1)
    learned = learn_force(inputs, -0.05 * qvel, np.repeat([0, 1], 200))
    naive, found = (
        errors(simulator, Hypothesis(simulator.theta, placed), given, starts, [2.0]).normalised
        for placed in ((), (learned,))
    )
    assert np.all(found < 0.1 * naive)
