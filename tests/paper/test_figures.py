"""Pictures: labelled, stable byte by byte, and true to the simulation they show."""

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import pytest
import synthetic
from conftest import CLEAR, TOUCHING
from PIL import Image

from fimpact.paper import reference_simulator
from fimpact.paper.figures import curve, examples, forces
from fimpact.paper.figures import panels as figures
from fimpact.paper.figures.replay import replay
from fimpact.report.plotting.scene import Scene, contacts, outline, plane_of_motion, surfaces
from fimpact.report.plotting.style import log_places, power


@pytest.fixture
def drawings():
    """Every figure as a function of the stem to draw it to."""
    plt.close("all")  # of other files in the same process
    trials, sweep = synthetic.campaign(3, 2), synthetic.sweep((0.6, 0.8), 3)
    return {
        "panels": lambda stem: figures.panels(trials, stem),
        "ablation": lambda stem: figures.ablation(trials, stem),
        "curve": lambda stem: figures.curve(sweep, trials, stem),
        "forces": lambda stem: forces.draw(*synthetic.plans()[::-1], stem),
    }


@pytest.mark.parametrize("name", ["panels", "ablation", "curve", "forces"])
def test_figures_are_stable_byte_by_byte(drawings, name, tmp_path):
    for turn in ("first", "second"):
        drawings[name](tmp_path / turn)
    for suffix in (".svg", ".png"):
        first, second = ((tmp_path / turn).with_suffix(suffix).read_bytes() for turn in ("first", "second"))
        assert first == second and len(first) > 10_000
    assert not plt.get_fignums()


@pytest.mark.parametrize(("name", "count"), [("panels", 4), ("ablation", 2), ("curve", 2), ("forces", 4)])
def test_every_panel_says_what_it_shows(drawings, name, count, monkeypatch):
    drawn = []
    for module in (figures, curve, forces):
        monkeypatch.setattr(module, "write", lambda figure, stem: drawn.append(figure))
    drawings[name]("unused")
    panels = drawn[0].axes
    assert len(panels) == count
    assert all(ax.get_xlabel() and ax.get_title("left") for ax in panels)
    assert all(ax.get_ylabel() or name != "panels" for ax in panels)
    plt.close(drawn[0])


def test_experiments_that_tell_nothing_are_drawn_as_none(monkeypatch):
    trials, drawn = synthetic.campaign(3, 2), []
    trials.loc[trials.method == "uniform", "information_trace"] = 1e-27
    monkeypatch.setattr(figures, "write", lambda figure, stem: drawn.append(figure))
    figures.panels(trials, "unused")
    information = drawn[0].axes[1]
    assert "none" in [label.get_text() for label in information.get_yticklabels()]
    assert information.get_title("left") == "Arm: none at random in 3 of 3 seeds"
    plt.close(drawn[0])


def test_methods_that_did_not_run_are_left_out_of_the_panels(monkeypatch):
    trials, drawn = synthetic.campaign(3, 2), []
    monkeypatch.setattr(figures, "write", lambda figure, stem: drawn.append(figure))
    for table in (trials, trials[trials.method != "contact_implicit"]):
        figures.panels(table, "unused")
    assert [len(figure.axes[0].lines) for figure in drawn] == [3, 2]
    plt.close("all")


def test_the_first_plan_that_touches_is_drawn_around_its_contact(monkeypatch):
    drawn = []
    monkeypatch.setattr(forces, "write", lambda figure, stem: drawn.append(figure))
    forces.draw(*synthetic.plans()[::-1], "unused")
    normal, tangential = drawn[0].axes[:2]
    assert normal.get_title("left") == "Arm, seed 1: correlation 0.70"
    assert tangential.get_title("left") == "MuJoCo's impulse: 1.10 of the plan's"
    assert 0.2 < normal.get_xlim()[0] < 0.305 < 0.345 < normal.get_xlim()[1] < 0.45
    plt.close("all")


def test_ticks_are_round_and_few():
    assert log_places(0.015, 0.6) == pytest.approx([0.02, 0.05, 0.1, 0.2, 0.5])
    assert log_places(0.98, 1.25) == pytest.approx([1, 1.1, 1.2])
    assert log_places(0.989, 1.024) == pytest.approx([0.99, 1, 1.01, 1.02])
    assert log_places(1, 1e5) == [1, 10, 100, 1e3, 1e4, 1e5]
    assert (power(1e4), power(2e4)) == ("$10^{4}$", r"$2 \times 10^{4}$")


def test_replay_is_the_experiment_that_was_run(system):
    scene = replay(system, system.nominal, TOUCHING[system.name])
    measurement, contact_steps = reference_simulator.simulate(system, system.nominal, TOUCHING[system.name])
    np.testing.assert_array_equal(scene.measurement, measurement)
    assert scene.touching.sum() == contact_steps > 0
    assert scene.time[0] == 0 and len(scene.time) == system.steps


def test_arm_is_drawn_from_its_pivot_to_the_wall(systems):
    scene = replay(systems["arm"], systems["arm"].nominal, TOUCHING["arm"])
    (at, normal), step = surfaces(scene)[0], int(np.argmax(scene.force))
    assert scene.pivots.tolist() == [[0, 0]]
    tip = outline(scene, scene.model.geom("tip").id, step)
    assert abs(((tip - at) @ normal).min()) < 0.01
    assert ((scene.contacts[step][0, 1] @ normal) > 0).all()  # the wall pushes


SHAPES = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body pos="0 0 1"><freejoint/>
<geom name="shape" type="{kind}" size="{size}" mass="1" euler="0 90 0"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("kind", "size", "width", "height"),
    [
        ("sphere", "0.1", 0.2, 0.2),
        ("capsule", "0.1 0.3", 0.8, 0.2),
        ("cylinder", "0.1 0.3", 0.6, 0.2),
        ("box", "0.1 0.2 0.3", 0.6, 0.2),
        ("ellipsoid", "0.1 0.2 0.3", 0.6, 0.2),
    ],
)
def test_outlines_have_the_size_of_their_geom(kind, size, width, height):
    model = mujoco.MjModel.from_xml_string(SHAPES.format(kind=kind, size=size))
    shape = outline(_still(model), model.geom("shape").id, 0)
    assert np.ptp(shape, axis=0) == pytest.approx([width, height], rel=0.01)
    assert (shape.min(0) + shape.max(0)) / 2 == pytest.approx([0, 1], abs=1e-6)


def _still(model) -> Scene:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    poses = (data.geom_xpos[None].copy(), data.geom_xmat.reshape(1, -1, 3, 3).copy())
    nothing = np.zeros((1, 0, 2, 2))
    return Scene(model, plane_of_motion(model), np.zeros(1), *poses, tuple(nothing), np.zeros((1, 1)), np.zeros((0, 2)))


RESTING = """<mujoco><worldbody>{floor}<body pos="0 0 0.1"><joint type="slide" axis="0 0 1"/>
<geom type="sphere" size="0.1" mass="2"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    "floor",
    # MuJoCo orders the two geoms of a contact by their type: the ball is second on a plane and first on a box.
    ['<geom type="plane" size="1 1 1"/>', '<geom type="box" size="1 1 0.5" pos="0 0 -0.5"/>'],
)
def test_forces_act_on_what_moves(floor):
    model = mujoco.MjModel.from_xml_string(RESTING.format(floor=floor))
    data = mujoco.MjData(model)
    for _ in range(2000):
        mujoco.mj_step(model, data)
    ((point, force),) = contacts(model, data, (0, 2))
    assert force == pytest.approx([0, 2 * 9.81], abs=1e-3)
    assert point == pytest.approx([0, 0], abs=1e-2)


def test_plane_of_motion_is_seen_from_above_without_gravity(systems):
    planes = {name: plane_of_motion(system.compile(system.nominal)) for name, system in systems.items()}
    assert planes == {"arm": (0, 1), "block": (0, 2)}


@pytest.fixture
def designs(system, tmp_path):
    """Files of one seed with two rounds: the designed experiments touch only in the second, the random never."""
    paths = {}
    for method, rounds in {"fisher": (CLEAR, TOUCHING), "uniform": (CLEAR, CLEAR)}.items():
        chosen = np.array([[designs[system.name] for designs in rounds]])
        paths[method] = tmp_path / f"{method}.npz"
        np.savez(paths[method], designs=chosen, seeds=[7], truth=system.nominal[None])
    return paths["fisher"], paths["uniform"]


def test_example_shows_the_round_with_most_contact(system, designs):
    (title, designed), (_, random) = examples.choose(system, *designs).items()
    assert title == "designed: seed 7, experiment 2"
    assert designed.touching.any() and not random.touching.any()


def test_example_files_are_stable_and_small(config, system, designs, tmp_path, monkeypatch):
    monkeypatch.setattr(examples, "FRAMES", 20)  # a quarter of the film
    for turn in ("first", "second"):
        outputs = {kind: tmp_path / turn / f"example.{kind}" for kind in ("svg", "png", "gif")}
        examples.draw(config, system.name, *designs, outputs)
    for kind, path in outputs.items():
        assert path.read_bytes() == (tmp_path / "first" / f"example.{kind}").read_bytes()
    with Image.open(outputs["gif"]) as film:
        assert film.n_frames == 20 and film.info["loop"] == 0
    assert outputs["gif"].stat().st_size < 250_000
