"""The exported model is the improved simulation: native fields in MJCF, what has none in a file of its own."""

import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from replayed import replayed

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.export.improved_model import Predicted, check_model, improved_spec, write_files, write_model
from fimpact.export.replay import Replay
from fimpact.recordings import Recording, Run, Unknown
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.windows import cut

XML = """<mujoco><option timestep="0.002"/><worldbody><body name="rod">
<joint name="pivot" axis="0 1 0" damping="0.02" armature="0.003"/>
<geom name="bar" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.015" mass="0.3"/></body></worldbody>
<actuator><motor name="motor" joint="pivot"/></actuator>
<sensor><jointpos name="angle" joint="pivot"/></sensor></mujoco>"""
SERVO = XML.replace("<motor", '<position kp="4" timeconst="0.05"')
PERIOD, SAMPLES, NOISE = 0.01, 60, 1e-3
THETA = np.array([0.31234567891, 0.0171234567891])


def recording(xml: str = XML, channels=("angle",), folder: str = ".") -> Recording:
    """Two driven runs, with nothing measured yet."""
    ny, time = len(channels), PERIOD * np.arange(SAMPLES)
    ctrl = [0.3 * np.sin(2 * np.pi * f * time + f)[:, None] for f in (1.3, 2.1)]
    runs = tuple(Run(f"run {i}", u, np.zeros((SAMPLES, ny)), True) for i, u in enumerate(ctrl))
    unknowns, nv = (Unknown("mass", "rod"), Unknown("damping", "pivot")), mujoco.MjModel.from_xml_string(xml).nv
    return Recording(xml, folder, PERIOD, channels, runs, unknowns, np.full(ny, NOISE), np.full(2 * nv, np.inf), 0.0)


def predict(given: Recording, *placed: Placed, refine: int = 1, length: int = 20) -> tuple[Hypothesis, Predicted]:
    """What a simulation with `placed` predicts of windows in which that was measured, with noise."""
    simulator, rng = Simulator(given, refine), np.random.default_rng(0)
    hypothesis, windows = Hypothesis(THETA, placed), cut(given.runs, length)
    shape, base = (len(windows.runs),), simulator.base
    qpos, qvel = rng.uniform(-1, 1, (*shape, base.nq)), rng.uniform(-2, 2, (*shape, base.nv))
    act = rng.uniform(-0.3, 0.3, (*shape, base.na))
    found = simulator.predict(hypothesis, windows, qpos, qvel, act)
    windows = replace(windows, measured=found + NOISE * rng.standard_normal(found.shape))
    return hypothesis, Predicted(windows, qpos, qvel, act, found)


def test_native_fields_alone_reproduce_the_improved_simulation(tmp_path):
    given = recording()
    hypothesis, predicted = predict(given, Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.05}))
    written = write_model(given, hypothesis, tmp_path, "dry friction -- at the pivot", predicted)
    assert [path.name for path in written.files] == ["improved.xml"] and written.difference < 1e-6
    assert "dry friction - - at the pivot" in (tmp_path / "improved.xml").read_text(encoding="utf-8")
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "improved.xml"))
    assert plain.dof_frictionloss[0] == 0.05 and plain.opt.timestep == 0.002
    assert plain.dof_solref[0, 0] == pytest.approx(0.004, rel=1e-3)  # exact, not MuJoCo's 20 ms
    np.testing.assert_allclose([plain.body("rod").mass[0], plain.dof_damping[0]], THETA, rtol=1e-12)


def test_other_files_differ(tmp_path):
    given = recording()
    hypothesis, predicted = predict(given, Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.05}))
    write_files(given, Hypothesis(THETA), tmp_path, "nothing", None, 0)
    assert check_model(given, hypothesis, tmp_path, predicted) > 1


def test_finer_numerics_are_written_where_the_simulation_had_them(tmp_path):
    xml = XML.replace("0.002", "0.01")
    given = recording(xml)
    hypothesis, predicted = predict(given, Placed(EFFECTS["viscous"], "pivot", {"damping": 0.05}), refine=8, length=0)
    written = write_model(given, hypothesis, tmp_path, "found", predicted)
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "improved.xml"))
    assert written.difference <= 0.02
    assert plain.opt.timestep < 0.01 or plain.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    write_files(given, hypothesis, tmp_path, "found", None, 0)
    assert check_model(given, hypothesis, tmp_path, predicted) > 0.02


def test_a_contact_is_no_quicker_at_a_finer_step():
    xml = XML.replace("<worldbody>", '<worldbody><geom name="floor" type="plane" size="1 1 1" solref="0.001 1"/>')
    spec = improved_spec(recording(xml), Hypothesis(THETA), None, 3)
    assert spec.option.timestep == 0.00025 and spec.geom("floor").solref[0] == 0.004
    assert spec.geom("bar").solref[0] == 0.02


def test_what_diverges_in_plain_mujoco_is_not_exported(tmp_path):
    given = recording()
    hypothesis, predicted = predict(given, Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.05}))
    wild = predicted._replace(qvel=np.full_like(predicted.qvel, 1e200))
    refused = write_model(given, hypothesis, tmp_path / "out", "found", wild)
    assert refused.files == [] and "diverges" in refused.refusal and not (tmp_path / "out").exists()


LAWS = {
    "stribeck": ("pivot", {"coulomb": 0.03, "excess": 0.02, "speed": 0.5}),
    "dahl": ("pivot", {"friction": 0.05, "displacement": 0.05}),
    "efficiency": ("pivot", {"driving": 0.2, "driven": 0.4}),
    "joint_elasticity": ("pivot", {"compliance": 0.1, "retardation": 0.01}),
    "backlash": ("pivot", {"gap": 0.05}),
    "sensor_bias": ("angle", {"offset": 0.1}),
    "sensor_delay": ("angle", {"delay": 0.013}),
    "command_delay": ("motor", {"delay": 0.013}),
}


@pytest.mark.parametrize("name", LAWS)
def test_exported_laws_are_ours_step_by_step(tmp_path, name):
    given, (site, values) = recording(), LAWS[name]
    hypothesis, predicted = predict(given, Placed(EFFECTS[name], site, values))
    plain = Simulator(given).predict(Hypothesis(THETA), *predicted[:4])
    assert np.abs(predicted.prediction - plain).max() > 1e-3
    np.testing.assert_allclose(replayed(given, hypothesis, predicted, tmp_path), predicted.prediction, atol=1e-9)


def test_a_lag_alone_is_native(tmp_path):
    given, lag = recording(), Placed(EFFECTS["actuator_lag"], "motor", {"time": 0.03})
    hypothesis, predicted = predict(given, lag)
    written = write_model(given, hypothesis, tmp_path, "found", predicted)
    assert [path.name for path in written.files] == ["improved.xml"] and written.difference < 0.1
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "improved.xml"))
    assert plain.actuator_dyntype[0] == mujoco.mjtDyn.mjDYN_FILTEREXACT
    write_files(given, Hypothesis(THETA), tmp_path, "nothing", None, 0)
    assert check_model(given, hypothesis, tmp_path, predicted) > 1


LAG = Placed(EFFECTS["actuator_lag"], "motor", {"time": 0.02})
CABLE = Placed(EFFECTS["cable_pull"], "rod", {"stiffness": 2.0, "anchor_x": 0.5, "anchor_y": 0.0, "anchor_z": -0.2})
TOGETHER = {
    "a gear felt by a law": (LAG, Placed(EFFECTS["load_dependent_friction"], "pivot", {"coefficient": 0.3}), 1e-9),
    "play behind a lag": (LAG, Placed(EFFECTS["backlash"], "pivot", {"gap": 0.02}), 1e-9),
    # A cable that MuJoCo holds is not held over a step, as our law is.
    "a cable on a moved centre": (CABLE, Placed(EFFECTS["com_shift"], "rod", {"x": 0.03, "y": 0.0, "z": -0.05}), 1e-3),
}


@pytest.mark.parametrize(("first", "second", "left"), TOGETHER.values(), ids=TOGETHER)
def test_effects_are_exported_together_as_they_were_fitted(tmp_path, first, second, left):
    given = recording()
    hypothesis, predicted = predict(given, first, second)
    np.testing.assert_allclose(replayed(given, hypothesis, predicted, tmp_path), predicted.prediction, atol=left)


def test_the_filter_of_a_servo_starts_where_it_was(tmp_path):
    given = recording(SERVO)
    friction = Placed(EFFECTS["stribeck"], "pivot", LAWS["stribeck"][1])
    hypothesis, predicted = predict(given, friction)
    assert predicted.act.shape == (6, 1)
    np.testing.assert_allclose(replayed(given, hypothesis, predicted, tmp_path), predicted.prediction, atol=1e-9)
    rest = predicted._replace(act=np.zeros((6, 1)))
    assert np.abs(replayed(given, hypothesis, rest, tmp_path) - predicted.prediction).max() > 1e-3


def test_a_law_without_a_field_runs_where_fimpact_is_not_installed(tmp_path):
    given = recording()
    hypothesis, predicted = predict(given, Placed(EFFECTS["stribeck"], "pivot", LAWS["stribeck"][1]))
    written = write_model(given, hypothesis, tmp_path, "stick and slip", predicted)
    assert [path.name for path in written.files] == ["improved.xml", "improved.py"] and written.difference < 1e-6
    text = (tmp_path / "improved.py").read_text(encoding="utf-8")
    assert "import fimpact" not in text and "from fimpact" not in text and "coulomb = 0.03 N m" in text
    code = (
        "import sys; sys.modules['fimpact'] = None; import numpy as np, improved;"
        "print(improved.simulate(improved.load('improved.xml'), np.zeros((5, 1)), [0.5], [0.0]).shape)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "(5, 1)"
    write_files(given, Hypothesis(THETA), tmp_path, "nothing", None, 0)
    assert not (tmp_path / "improved.py").exists()


def test_the_file_says_what_its_stepper_leaves_to_others(tmp_path):
    given = recording()
    late = Placed(EFFECTS["command_delay"], "motor", {"delay": 0.02})
    scaled = Placed(EFFECTS["sensor_scale"], "angle", {"change": 0.1})
    write_files(given, Hypothesis(THETA, (late, scaled)), tmp_path, "found", None, 0)
    replay = Replay(given, tmp_path)
    scene, model = replay.scene, replay.model
    assert "a row of commands(ctrl, substeps)[0]" in scene.__doc__ and "measurements(rows, ctrl)" in scene.__doc__
    ctrl, substeps = given.runs[0].ctrl, round(PERIOD / model.opt.timestep)
    stepper, drive = scene.Stepper(model, mujoco.MjData(model)), scene.commands(ctrl, substeps)[0]
    rows = np.array([stepper.step(row) for row in drive])[::substeps]
    expected = scene.simulate(model, ctrl, [0.0], [0.0])
    np.testing.assert_allclose(scene.measurements(rows, ctrl), expected, atol=1e-12)


WRIST = """<body name="tip" pos="0 0 -0.4"><joint name="wrist" axis="0 1 0" springdamper="0.3 1"/>
<geom size="0.02" pos="0 0 -0.1" mass="0.1"/></body></body>"""


def test_a_mass_that_is_exported_leaves_servos_and_springs_as_they_were_fitted():
    """MuJoCo's compiler works out `dampratio` and `springdamper` from the masses that it finds."""
    given = recording(XML.replace("</body>", WRIST).replace("<motor", '<position kp="20" dampratio="1"'))
    payload = Placed(EFFECTS["payload"], "tip", {"mass": 0.3, "place": 0.2})
    written = improved_spec(given, Hypothesis(THETA, (payload,))).compile()
    ours = Simulator(given).model(Hypothesis(THETA, (payload,)))
    assert ours.body("tip").mass[0] == pytest.approx(0.4) and ours.jnt_stiffness[1] > 0
    for field in ("body_mass", "jnt_stiffness", "dof_damping", "actuator_gainprm", "actuator_biasprm", "dof_solref"):
        np.testing.assert_allclose(getattr(written, field), getattr(ours, field), rtol=1e-12, err_msg=field)


@pytest.mark.parametrize(("kind", "native"), [("velocimeter", True), ("framepos", False)])
def test_a_sensor_that_is_turned_reads_the_same_by_the_files(tmp_path, kind, native):
    """Only what reads its own axes turns with its site; a marker's place is read along the world's."""
    place = 'objtype="site" objname="tip"' if kind == "framepos" else 'site="tip"'
    xml = XML.replace("</body>", '<site name="tip" pos="0.1 0 -0.4"/></body>')
    xml = xml.replace("</sensor>", f'<{kind} name="tip" {place}/></sensor>')
    given = recording(xml, tuple(f"tip[{i}]" for i in range(3)))
    turned = Placed(EFFECTS["misalignment"], "tip", {"turn_x": 0.1, "turn_y": -0.2, "turn_z": 0.15})
    hypothesis, predicted = predict(given, turned)
    theirs = replayed(given, hypothesis, predicted, tmp_path)
    assert np.ptp(theirs) > 0.1 and (tmp_path / "improved.py").exists() != native
    np.testing.assert_allclose(theirs, predicted.prediction, atol=1e-6)


def test_meshes_travel_with_the_model(tmp_path):
    (tmp_path / "parts").mkdir()
    corners = "\n".join(f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1))
    faces = "f 1 2 3\nf 2 4 3\nf 5 7 6\nf 6 7 8\nf 1 5 2\nf 2 5 6\nf 3 4 7\nf 4 8 7\nf 1 3 5\nf 3 7 5\nf 2 6 4\nf 4 6 8"
    (tmp_path / "parts" / "block.obj").write_text(f"{corners}\n{faces}\n")
    xml = XML.replace("<worldbody>", '<asset><mesh name="block" file="block.obj"/></asset><worldbody>').replace(
        "<option", f'<compiler meshdir="{tmp_path / "parts"}"/><option'
    )
    xml = xml.replace("</body>", '<geom type="mesh" mesh="block" mass="0.01" contype="0" conaffinity="0"/></body>')
    given, out = recording(xml), tmp_path / "out"
    hypothesis, predicted = predict(given, Placed(EFFECTS["coulomb"], "pivot", {"friction": 0.05}))
    written = write_model(given, hypothesis, out, "found", predicted)
    assert out / "assets" / "block.obj" in written.files
    (tmp_path / "parts" / "block.obj").unlink()
    assert mujoco.MjModel.from_xml_path(str(out / "improved.xml")).nmesh == 1
