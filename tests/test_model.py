"""The exported model is the improved simulation: native fields in MJCF, what has none in a file of its own."""

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch import export, model
from fimpact.mismatch.coordinates import NOTHING, coordinates
from fimpact.mismatch.evidence import weigh_evidence
from fimpact.mismatch.explain import explain
from fimpact.mismatch.judge import base_fit, bench, settle
from fimpact.mismatch.model import check_model, refusal, write_model
from fimpact.mismatch.replayed import Replay, replayed
from fimpact.mismatch.scales import scales
from fimpact.mismatch.simulate import Hypothesis, Simulator
from fimpact.recordings import Recording, Run, Unknown

XML = """<mujoco><option timestep="0.002"/><worldbody><body name="rod">
<joint name="pivot" axis="0 1 0" damping="0.02" armature="0.003"/>
<geom name="bar" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.015" mass="0.3"/></body></worldbody>
<actuator><motor name="motor" joint="pivot"/></actuator>
<sensor><jointpos name="angle" joint="pivot"/></sensor></mujoco>"""
NOISE, PERIOD, SAMPLES = 2e-4, 0.01, 40


def record(friction: float, xml: str = XML, folder: str = ".") -> Recording:
    """A driven pendulum with dry friction, lighter damped than its model says; two runs of six are held out."""
    rng, spec = np.random.default_rng(1), mujoco.MjSpec.from_string(xml)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    truth = spec.compile()
    truth.dof_frictionloss[:], truth.dof_damping[:] = friction, 0.017
    runs = []
    for number in range(6):
        data, time = mujoco.MjData(truth), np.arange(SAMPLES) * PERIOD
        data.qpos[:] = rng.uniform(-1, 1)
        ctrl = 0.5 * np.sin(2 * np.pi * rng.uniform(1, 3) * time + rng.uniform(0, 6))[:, None]
        angle = []
        for u in ctrl:
            angle.append(data.qpos.copy())
            data.ctrl[:] = u
            mujoco.mj_step(truth, data, nstep=5)
        measured = np.array(angle) + NOISE * rng.standard_normal((SAMPLES, 1))
        runs.append(Run(f"run {number}", ctrl, measured, number >= 4))
    unknowns = (Unknown("mass", "rod", 0.2), Unknown("damping", "pivot", 0.3))
    return Recording(xml, folder, PERIOD, ("angle",), tuple(runs), unknowns, np.array([NOISE]), np.full(2, np.inf), 0.2)


def diagnosis_of(recording: Recording, *placed: Placed) -> SimpleNamespace:
    """A diagnosis as the naming stage would leave it had it answered `placed`."""
    made = bench(recording)
    simulator = made.training.simulator
    sizes = tuple({k: abs(v) for k, v in p.values.items()} for p in placed)
    naive = explain(*base_fit(made, coordinates(simulator), Hypothesis(simulator.theta)))
    best = naive
    if placed:
        best = explain(*base_fit(made, coordinates(simulator, placed, sizes), Hypothesis(simulator.theta, placed)))
        naive = explain(naive.fitted, settle(made.held_out, naive.fitted.point.hypothesis))
    naming = SimpleNamespace(naive=naive, best=best, covariance=best.fitted.covariance)
    return SimpleNamespace(recording=recording, bench=made, naming=naming, evidence=weigh_evidence(made, naive, best))


@pytest.fixture(scope="module")
def rubbing() -> Recording:
    return record(0.02)


def test_native_fields_alone_reproduce_the_improved_simulation(rubbing, tmp_path):
    diagnosis = diagnosis_of(rubbing, Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.015}))
    written = write_model(diagnosis, tmp_path)
    assert [path.name for path in written.files] == ["improved.xml"]
    assert check_model(diagnosis, tmp_path) < 0.02
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "improved.xml"))
    assert plain.dof_frictionloss[0] == pytest.approx(0.02, rel=0.1)
    theta = diagnosis.naming.best.fitted.point.hypothesis.theta
    np.testing.assert_allclose([plain.body("rod").mass[0], plain.dof_damping[0]], theta, rtol=1e-12)


def test_a_law_without_a_field_runs_where_fimpact_is_not_installed(rubbing, tmp_path):
    law = Placed(EFFECTS["stribeck"], "pivot", {"coulomb": 0.02, "excess": 0.001, "speed": 1.0})
    diagnosis = diagnosis_of(rubbing, law)
    written = write_model(diagnosis, tmp_path)
    assert [path.name for path in written.files] == ["improved.xml", "improved.py"]
    assert check_model(diagnosis, tmp_path) < 0.02
    assert "import fimpact" not in (text := (tmp_path / "improved.py").read_text()) and "from fimpact" not in text
    code = (
        "import sys; sys.modules['fimpact'] = None; import numpy as np, improved;"
        "print(improved.simulate(improved.load('improved.xml'), np.zeros((5, 1)), [0.5], [0.0]).shape)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "(5, 1)"


def named(made, *placed: Placed) -> SimpleNamespace:
    """A diagnosis that answered `placed`, as far as the writing of files looks at it."""
    hypothesis = Hypothesis(made.training.simulator.theta, placed)
    best = SimpleNamespace(placed=placed, fitted=SimpleNamespace(point=SimpleNamespace(hypothesis=hypothesis)))
    recording, errors = made.training.simulator.recording, SimpleNamespace(before=2.0, after=1.0)
    return SimpleNamespace(recording=recording, bench=made, naming=SimpleNamespace(best=best), evidence=errors)


def exported(diagnosis, folder, monkeypatch):
    """The files' own functions, and their model."""
    monkeypatch.setattr(export, "in_words", lambda *_: "found")
    export.write_files(diagnosis, folder, None, 0)
    scene = export.player_of(diagnosis, folder)
    return scene, scene.load(folder / "improved.xml")


def both(diagnosis, folder, monkeypatch):
    """Held-out windows, (w, T, ny), by the exported files and by our simulation."""
    made, hypothesis = diagnosis.bench, diagnosis.naming.best.fitted.point.hypothesis
    windows, (qpos, qvel) = made.held_out.windows, made.held_out.starts
    exported(diagnosis, folder, monkeypatch)
    theirs = Replay(diagnosis, folder).predict(hypothesis, windows, qpos, qvel)
    return theirs, made.training.simulator.predict(hypothesis, windows, qpos, qvel)


@pytest.mark.parametrize(
    "name",
    "stribeck dahl efficiency joint_elasticity backlash sensor_bias sensor_delay command_delay".split(),
)
def test_exported_laws_are_ours_step_by_step(rubbing, tmp_path, monkeypatch, name):
    made, effect = bench(rubbing), EFFECTS[name]
    simulator, start = made.training.simulator, made.held_out.starts
    evaluated = made.held_out.evaluate(Hypothesis(simulator.theta), *start, NOTHING)
    site = effect.sites(simulator.base, rubbing.channels)[0]
    values = effect.probes(scales(made.held_out, evaluated), simulator.base, site)[0]
    placed, windows = Placed(effect, site, values), made.held_out.windows
    theirs, ours = both(named(made, placed), tmp_path, monkeypatch)
    # What was before the start of a simulation, a file does not know.
    before, after = simulator.late.reach(Hypothesis(simulator.theta, (placed,)), windows)
    own = slice(before, windows.length - after)
    np.testing.assert_allclose(theirs[:, own], ours[:, own], atol=1e-9)


LAG = Placed(EFFECTS["actuator_lag"], "motor", {"time": 0.02})
CABLE = Placed(EFFECTS["cable_pull"], "rod", {"stiffness": 2.0, "anchor_x": 0.5, "anchor_y": 0.0, "anchor_z": -0.2})
TOGETHER = {
    "a gear felt by a law": (LAG, Placed(EFFECTS["load_dependent_friction"], "pivot", {"coefficient": 0.3}), 1e-9),
    "play behind a lag": (LAG, Placed(EFFECTS["backlash"], "pivot", {"gap": 0.02}), 1e-9),
    # A cable that MuJoCo holds is not held over a step, as our law is.
    "a cable on a moved centre": (CABLE, Placed(EFFECTS["com_shift"], "rod", {"x": 0.03, "y": 0.0, "z": -0.05}), 1e-3),
}


@pytest.mark.parametrize(("first", "second", "left"), TOGETHER.values(), ids=TOGETHER)
def test_effects_are_exported_together_as_they_were_fitted(rubbing, tmp_path, monkeypatch, first, second, left):
    theirs, ours = both(named(bench(rubbing), first, second), tmp_path, monkeypatch)
    np.testing.assert_allclose(theirs, ours, atol=left)


def test_a_lag_alone_is_native(rubbing):
    spec = export.improved_model(named(bench(rubbing), LAG))
    assert spec.compile().actuator_dyntype[0] == mujoco.mjtDyn.mjDYN_FILTEREXACT


def test_the_file_says_what_its_stepper_leaves_to_others(rubbing, tmp_path, monkeypatch):
    made = bench(rubbing)
    late = Placed(EFFECTS["command_delay"], "motor", {"delay": 0.02})
    scaled = Placed(EFFECTS["sensor_scale"], "angle", {"change": 0.1})
    scene, loaded = exported(named(made, late, scaled), tmp_path, monkeypatch)
    assert "a row of commands(ctrl, substeps)[0]" in scene.__doc__ and "measurements(rows, ctrl)" in scene.__doc__
    ctrl, substeps, data = rubbing.runs[0].ctrl, round(PERIOD / loaded.opt.timestep), mujoco.MjData(loaded)
    stepper, drive = scene.Stepper(loaded, data), scene.commands(ctrl, substeps)[0]
    rows = np.array([stepper.step(row) for row in drive])[::substeps]
    expected = scene.simulate(loaded, ctrl, [0.0], [0.0])
    np.testing.assert_allclose(scene.measurements(rows, ctrl), expected, atol=1e-12)


WRIST = """<body name="tip" pos="0 0 -0.4"><joint name="wrist" axis="0 1 0" springdamper="0.3 1"/>
<geom size="0.02" pos="0 0 -0.1" mass="0.1"/></body></body>"""
SERVO = XML.replace("</body>", WRIST).replace("<motor", '<position kp="20" dampratio="1"')


def test_a_mass_that_is_exported_leaves_servos_and_springs_as_they_were_fitted():
    """MuJoCo's compiler works out `dampratio` and `springdamper` from the masses that it finds."""
    run = Run("run", np.zeros((SAMPLES, 1)), np.zeros((SAMPLES, 1)), False)
    recording = Recording(SERVO, ".", PERIOD, ("angle",), (run,), (), np.ones(1), np.full(4, np.inf), 0.0)
    simulator, payload = Simulator(recording), Placed(EFFECTS["payload"], "tip", {"mass": 0.3, "place": 0.2})
    made = SimpleNamespace(training=SimpleNamespace(simulator=simulator))
    written = export.improved_model(named(made, payload)).compile()
    ours = simulator.model(Hypothesis(np.zeros(0), (payload,)))
    assert ours.body("tip").mass[0] == pytest.approx(0.4) and ours.jnt_stiffness[1] > 0
    for field in ("body_mass", "jnt_stiffness", "dof_damping", "actuator_gainprm", "actuator_biasprm"):
        np.testing.assert_allclose(getattr(written, field), getattr(ours, field), rtol=1e-12, err_msg=field)


@pytest.mark.parametrize(("kind", "native"), [("velocimeter", True), ("framepos", False)])
def test_a_sensor_that_is_turned_reads_the_same_by_the_files(tmp_path, monkeypatch, kind, native):
    """Only what reads its own axes turns with its site; a marker's place is read along the world's."""
    place = 'objtype="site" objname="tip"' if kind == "framepos" else 'site="tip"'
    xml = XML.replace("</body>", '<site name="tip" pos="0.1 0 -0.4"/></body>')
    xml = xml.replace("</sensor>", f'<{kind} name="tip" {place}/></sensor>')
    whole, channels = np.zeros((SAMPLES, 3)), tuple(f"tip[{i}]" for i in range(3))
    runs = tuple(Run(f"run {held}", np.ones((SAMPLES, 1)), whole, held) for held in (False, True))
    recording = Recording(xml, ".", PERIOD, channels, runs, (), np.ones(3), np.full(2, np.inf), 0.0)
    turned = Placed(EFFECTS["misalignment"], "tip", {"turn_x": 0.1, "turn_y": -0.2, "turn_z": 0.15})
    theirs, ours = both(named(bench(recording), turned), tmp_path, monkeypatch)
    assert np.ptp(ours) > 0.1 and (tmp_path / "improved.py").exists() != native
    np.testing.assert_allclose(theirs, ours, atol=1e-6)


def test_what_does_not_improve_held_out_runs_is_not_exported(tmp_path):
    clean = record(0.0)
    assert "no effect" in refusal(diagnosis_of(clean))
    useless = diagnosis_of(clean, Placed(EFFECTS["coulomb"], "pivot", {"friction": 1e-4}))
    if useless.evidence.low > 0:
        useless.evidence = SimpleNamespace(**{**vars(useless.evidence), "low": -0.01})
    assert "do not improve" in refusal(useless)
    assert write_model(useless, tmp_path / "out").files == []
    assert not (tmp_path / "out").exists()


def test_what_predicts_worse_than_the_naive_model_is_not_exported(rubbing, tmp_path, monkeypatch):
    diagnosis = diagnosis_of(rubbing, Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.015}))
    naive = model._ours(diagnosis, diagnosis.naming.naive.judged)
    monkeypatch.setattr(model, "_left", lambda *_, **__: 1.01 * naive)
    refused = write_model(diagnosis, tmp_path / "out")
    assert refused.files == [] and refused.difference is None and "depends on the time step" in refused.refusal
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(model, "_left", lambda *_, **__: 0.99 * naive)
    assert write_model(diagnosis, tmp_path / "out").files == [tmp_path / "out" / "improved.xml"]


def test_files_that_differ_are_judged_from_initial_states_of_their_own(rubbing, tmp_path):
    diagnosis = diagnosis_of(rubbing, Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.015}))
    before = write_model(diagnosis, tmp_path).difference
    best = diagnosis.naming.best
    elsewhere = replace(best.judged.point, qvel=best.judged.point.qvel + 0.05)
    diagnosis.naming.best = replace(best, judged=replace(best.judged, point=elsewhere))
    left = [(replayed(diagnosis, tmp_path, profiled) ** 2).sum() for profiled in (False, True)]
    assert left[0] > 2 * left[1]
    assert check_model(diagnosis, tmp_path) == pytest.approx(before, abs=1e-2)
    assert write_model(diagnosis, tmp_path).difference == pytest.approx(before, abs=1e-2)


def test_meshes_travel_with_the_model(tmp_path):
    (tmp_path / "parts").mkdir()
    corners = "\n".join(f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1))
    faces = "f 1 2 3\nf 2 4 3\nf 5 7 6\nf 6 7 8\nf 1 5 2\nf 2 5 6\nf 3 4 7\nf 4 8 7\nf 1 3 5\nf 3 7 5\nf 2 6 4\nf 4 6 8"
    (tmp_path / "parts" / "block.obj").write_text(f"{corners}\n{faces}\n")
    xml = XML.replace("<worldbody>", '<asset><mesh name="block" file="block.obj"/></asset><worldbody>').replace(
        "<option", f'<compiler meshdir="{tmp_path / "parts"}"/><option'
    )
    xml = xml.replace("</body>", '<geom type="mesh" mesh="block" mass="0.01" contype="0" conaffinity="0"/></body>')
    diagnosis = diagnosis_of(record(0.02, xml), Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.015}))
    out = tmp_path / "out"
    written = write_model(diagnosis, out)
    assert out / "assets" / "block.obj" in written.files
    (tmp_path / "parts" / "block.obj").unlink()
    assert mujoco.MjModel.from_xml_path(str(out / "improved.xml")).nmesh == 1
