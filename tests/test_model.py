"""The exported model is the improved simulation: native fields in MJCF, what has none in a file of its own."""

import subprocess
import sys
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch import model
from fimpact.mismatch.coordinates import NOTHING, coordinates
from fimpact.mismatch.evidence import weigh_evidence
from fimpact.mismatch.explain import explain
from fimpact.mismatch.judge import base_fit, bench, settle
from fimpact.mismatch.model import check_model, refusal, write_model
from fimpact.mismatch.scales import scales
from fimpact.mismatch.simulate import Hypothesis
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


@pytest.mark.parametrize(
    "name",
    "stribeck efficiency joint_elasticity backlash sensor_bias sensor_delay command_delay".split(),
)
def test_exported_laws_are_ours_step_by_step(rubbing, tmp_path, monkeypatch, name):
    made, effect = bench(rubbing), EFFECTS[name]
    simulator, windows, (qpos, qvel) = made.training.simulator, made.held_out.windows, made.held_out.starts
    start = made.held_out.evaluate(Hypothesis(simulator.theta), qpos, qvel, NOTHING)
    site = effect.sites(simulator.base, rubbing.channels)[0]
    values = effect.probes(scales(made.held_out, start), simulator.base, site)[0]
    hypothesis = Hypothesis(simulator.theta, (Placed(effect, site, values),))
    fitted = SimpleNamespace(point=SimpleNamespace(hypothesis=hypothesis))
    best = SimpleNamespace(placed=hypothesis.placed, fitted=fitted)
    errors = SimpleNamespace(before=2.0, after=1.0)
    diagnosis = SimpleNamespace(recording=rubbing, bench=made, naming=SimpleNamespace(best=best), evidence=errors)
    monkeypatch.setattr(model, "in_words", lambda *_: name)
    model._write(diagnosis, tmp_path, None, 0)
    scene = model._player(diagnosis, tmp_path)
    loaded, ours = scene.load(tmp_path / "improved.xml"), simulator.predict(hypothesis, windows, qpos, qvel)
    for row, (run, first) in enumerate(zip(windows.runs, windows.first, strict=True)):
        theirs = scene.simulate(loaded, windows.ctrl[run], qpos[row], qvel[row], int(first), windows.length)
        np.testing.assert_allclose(theirs, ours[row], atol=1e-9)


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
    monkeypatch.setattr(model, "_replayed", lambda *_: 1.01 * naive)
    refused = write_model(diagnosis, tmp_path / "out")
    assert refused.files == [] and refused.difference is None and "depends on the time step" in refused.refusal
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(model, "_replayed", lambda *_: 0.99 * naive)
    assert write_model(diagnosis, tmp_path / "out").files == [tmp_path / "out" / "improved.xml"]


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
