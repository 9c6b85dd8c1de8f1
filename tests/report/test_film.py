"""What was recorded, and what the models say of it, becomes motion again; where it cannot, the page says why."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from diagnosed import rubbing
from PIL import Image
from recorded import ROD as XML

from fimpact.diagnosis.held_out import starts_of
from fimpact.report.film import draw_film, draw_moving, stretch
from fimpact.report.plotting.gif import FEWEST, write_gif
from fimpact.report.plotting.scene import Scene, outline
from fimpact.report.plotting.stroboscopic import View
from fimpact.report.poses import configurations, scene_of, undrawable

FREE = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><body name="cube" pos="0 0 1"><freejoint/>
<geom type="box" size="0.1 0.1 0.1"/></body></worldbody><sensor><framepos name="p" objtype="body" objname="cube"/>
<framequat name="q" objtype="body" objname="cube"/></sensor></mujoco>"""
POSE = ("p[0]", "p[1]", "p[2]", "q[0]", "q[1]", "q[2]", "q[3]")


@pytest.fixture(scope="module")
def diagnosis():
    return rubbing()


@pytest.fixture(scope="module")
def given(diagnosis):
    """Runs and the states at every sample of them."""
    runs = diagnosis.recording.held_out
    return runs, starts_of(diagnosis.recording, runs, diagnosis.prepared.noise, diagnosis.simulator)


def test_poses_come_back_from_their_readings_and_gaps_are_filled():
    model = mujoco.MjModel.from_xml_string(FREE)
    readings = np.zeros((5, 7))
    readings[:, :3] = np.arange(5)[:, None] * [0.0, 0.2, 1.0]
    readings[:, 3] = 2.0  # not quite a unit quaternion
    readings[2] = np.nan
    qpos = configurations(model, POSE, readings)
    np.testing.assert_allclose(qpos[:, 2], np.arange(5))
    np.testing.assert_allclose(qpos[:, 3:], [[1, 0, 0, 0]] * 5)
    assert scene_of(model, qpos, np.arange(5.0)).axes == (1, 2)  # it falls, and drifts along y


@pytest.mark.parametrize(
    ("xml", "channels", "words"),
    [
        (XML, ("angle",), ""),
        (FREE, POSE, ""),
        (FREE, POSE[:3], "was not measured"),
        (XML.replace("jointpos", "jointvel"), ("angle",), "how pivot stood was not measured"),
        (
            re.sub("<geom[^>]*>", '<inertial pos="0 0 -0.2" mass="0.3" diaginertia="1e-3 1e-3 1e-3"/>', XML),
            ("angle",),
            "no geom that moves",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_drawn_is_said_in_one_sentence(xml, channels, words):
    reason = undrawable(mujoco.MjModel.from_xml_string(xml), channels)
    assert words in reason and bool(reason) == bool(words) and "\n" not in reason


def test_a_stretch_shows_what_was_recorded_and_each_model_beside_it(diagnosis, given):
    part = stretch(diagnosis, *given)
    assert part.run == "run_2" and part.time[0] == 0 and len(part.time) == 400
    np.testing.assert_array_equal(part.readings["recorded"], diagnosis.recording.held_out[0].measured)
    naive, improved = (np.std(part.readings[n] - part.readings["recorded"]) for n in ("naive fit", "improved"))
    assert improved < 0.3 * naive


def test_a_film_shows_all_three_and_stays_small(diagnosis, given, tmp_path):
    assert draw_film(diagnosis, *given, tmp_path / "motion.gif") == ""
    with Image.open(tmp_path / "motion.gif") as film:
        assert film.n_frames >= 30 and film.info["loop"] == 0
        shot = np.asarray(film.convert("RGB")).reshape(-1, 3).astype(int)
    assert (tmp_path / "motion.gif").stat().st_size < 1_500_000
    for colour in ((0xD5, 0x5E, 0x00), (0x00, 0x72, 0xB2)):
        assert (np.abs(shot - colour).sum(1) < 90).any()


def test_what_is_seen_edge_on_is_a_line_and_what_has_left_is_nothing(diagnosis):
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom type='box' size='0.1 0.2 0.3'/></body></worldbody></mujoco>"
    )
    position, rotation = np.zeros((2, 1, 3)), np.tile(np.eye(3), (2, 1, 1, 1))
    position[1], rotation[0, 0, 0, 0] = 1e300, 0.0  # a plate that is seen from its edge; far away
    scene = Scene(model, (0, 2), np.arange(2.0), position, rotation, (), np.zeros((2, 1)), np.zeros((0, 2)))
    ends = outline(scene, 0, 0)
    assert len(ends) == 2 and np.ptp(ends, axis=0) == pytest.approx([0, 0.6])
    view = View(np.zeros(2), np.ones(2), 1.0, (0, 1))
    assert draw_moving(None, scene, 1, "black", 1.0, view) == []


def test_what_cannot_be_drawn_leaves_no_file(diagnosis, given, tmp_path):
    blind = replace(diagnosis, recording=replace(diagnosis.recording, channels=()))
    words = draw_film(blind, *given, tmp_path / "motion.gif")
    assert words.startswith("No film") and not list(tmp_path.iterdir())


def test_a_film_that_is_too_large_loses_frames_but_not_all(tmp_path):
    rng = np.random.default_rng(0)
    shots = [rng.integers(0, 255, (60, 80, 3), np.uint8) for _ in range(80)]
    for most, frames in ((None, 80), (100_000, 20), (1, FEWEST)):
        write_gif(shots, ["black", "red"], 20, tmp_path / "noise.gif", most)
        with Image.open(tmp_path / "noise.gif") as film:
            assert film.n_frames == frames, most
