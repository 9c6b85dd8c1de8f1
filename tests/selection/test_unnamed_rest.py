"""Physics without a name: where it is and what it follows."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from recorded import ARM, BALL, ROD, arm, record, rod, waves

from fimpact.diagnosis.remainder import FOLLOWED, KINDS
from fimpact.effects import EFFECTS
from fimpact.recordings import Recording
from fimpact.selection.carried_bodies import Carried, sliding
from fimpact.selection.forced import fit_forced
from fimpact.selection.swaying_bases import swaying
from fimpact.selection.unnamed_rest import Leftover, leftover, smooth_functions
from fimpact.smoothing.noise_levels import CHANGE
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

AXES = "1 0 0", "0 1 0", "0 0 1"


@cache
def pulled(what: str) -> Recording:
    """A rod whose pivot rubs in one place only, or that a wind blows at for a while in each run."""

    def rough(model, data):
        spot = np.exp(-(((data.qpos[0] - 0.3) / 0.15) ** 2))
        return np.array([-0.08 * np.tanh(data.qvel[0] / 0.01) * spot])

    def wind(model, data):
        return np.array([0.05 * np.exp(-(((data.time - 2.0) / 0.4) ** 2))])

    made = {"rough": rough, "wind": wind}[what]
    return record(ROD, ("angle",), [waves(400, [0.2], i) for i in range(5)], 3e-4, pull=made, fine=20)


def left_of(recording: Recording, *answered: tuple[str, str]) -> Leftover:
    made = prepare(recording)
    naive = smooth(made.track, made.begun, made.noise)
    fit = fit_forced(made, naive, [(EFFECTS[name], site) for name, site in answered]) if answered else naive
    return leftover(fit, (naive.tau**2).sum(0))


@pytest.mark.parametrize(("what", "follows"), [("rough", "friction with position"), ("wind", "time")])
def test_what_is_left_is_said_by_place_and_by_what_it_follows(what, follows):
    found = left_of(pulled(what))
    assert (found.dof, found.follows) == (0, follows) and found.share > 0.15


def test_a_gain_that_swings_with_the_time_is_told_from_a_force():
    def swings(model, data):
        return 0.02 * np.sin(2 * np.pi * data.time / 1.1) * data.ctrl

    found = left_of(record(ROD, ("angle",), [waves(400, [0.5], i) for i in range(5)], 3e-4, pull=swings, fine=20))
    assert (found.dof, found.follows) == (0, "gain with time") and found.share > 0.15


def test_a_gust_at_a_link_is_one_push_whatever_the_pose():
    """Its torques at the joints are of either sign from run to run."""

    def gust(model, data):
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian, None, model.body("lower").id)
        return 0.3 * np.exp(-(((data.time - 2.0) / 0.3) ** 2)) * np.array([0.8, 0.0, 0.6]) @ jacobian

    commands = [waves(400, [2.0, 0.6], i) for i in range(6)]
    found = left_of(record(ARM, ("q1", "q2"), commands, 5e-4, pull=gust, fine=20))
    assert (found.dof, found.follows) == (1, "push with time") and found.share > 0.15


@cache
def loose() -> Recording:
    """An arm of whose lower link a third slides to and fro across it, by 3 cm."""
    tool = """<body name="tool" pos="0 0 -0.125"><joint type="slide" axis="1 0 0" range="-0.015 0.015" limited="true"
    solreflimit="0.005 1"/><geom type="sphere" size="0.01" mass="0.1"/></body>"""
    xml = ARM.replace('mass="0.3"/></body>', f'mass="0.2"/>{tool}</body>')

    def whole(model: mujoco.MjModel) -> None:
        model.body_inertia[model.body("lower").id] *= 0.3 / 0.2

    seen = record(xml, ("q1", "q2"), [waves(400, [2.0, 0.6], i) for i in range(4)], 3e-4, whole, fine=20)
    return replace(seen, xml=ARM, start_sd=seen.start_sd[:4])


def test_what_slides_in_a_body_is_found_there_along_its_axis():
    found = left_of(loose())
    assert (found.dof, found.follows) == (1, "slide with pull along x") and found.share > 0.15
    kind, what = found.follows.split(" with ")
    assert kind in KINDS and what in FOLLOWED  # it is told in words of its own


def test_a_body_lacks_the_weight_of_what_falls_in_it_until_that_meets_the_other_end():
    push, axes, pull = np.zeros((3, 60, 1)), np.tile(np.eye(3), (60, 1, 1)), np.zeros((60, 3))
    push[0], pull[:30, 0], pull[30:, 0] = 1.0, 9.81, -9.81
    track = SimpleNamespace(period=0.01, slices=lambda: [slice(0, 60)])
    ((axis, forces),) = sliding(track, Carried(0, push, axes, pull, 0.3, 9.81 * 0.2**2 / 2), 2)
    assert axis == "x" and forces.shape == (60, 2, 1)
    np.testing.assert_allclose(forces[30:49, 1, 0], 9.81)  # 0.2 s across
    np.testing.assert_allclose(forces.sum(0), 0.0, atol=1e-9)  # stopped by the end
    assert not forces[:30].any() and not forces[51:].any()


@cache
def on_a_stand() -> Recording:
    """An arm on a stand of 3 kg that swings along x, 3 times a second."""
    stand = """<body name="stand"><joint type="slide" axis="1 0 0" stiffness="1100" damping="6"/>
    <geom type="sphere" size="0.01" mass="3"/>"""
    xml = ARM.replace("<worldbody>", f"<worldbody>{stand}").replace("</worldbody>", "</body></worldbody>")
    seen = record(xml, ("q1", "q2"), [waves(400, [2.0, 0.6], i) for i in range(4)], 3e-4, fine=20)
    return replace(seen, xml=ARM, start_sd=seen.start_sd[:4])


def test_the_sway_of_a_stand_is_found_along_its_axis():
    found = left_of(on_a_stand())
    assert (found.dof, found.follows) == (0, "sway with push along x") and found.share > 0.5
    kind, what = found.follows.split(" with ")
    assert kind in KINDS and what in FOLLOWED


@pytest.mark.parametrize("joints", ["<freejoint/>", "".join(f'<joint type="slide" axis="{a}"/>' for a in AXES)])
def test_what_flies_stands_on_nothing(joints):
    xml = BALL.replace('<freejoint name="free"/>', joints)
    fit = SimpleNamespace(track=SimpleNamespace(model=mujoco.MjModel.from_xml_string(xml)))
    assert not list(swaying(fit, 4))


@pytest.mark.parametrize("recording", [rod, arm])
def test_where_nothing_is_missing_nothing_is_left(recording):
    assert left_of(recording()) == Leftover(None, None, 0.0, ())


def test_a_right_name_is_not_doubted_and_leaves_nothing():
    assert left_of(rod(0.15), ("coulomb", "pivot")) == Leftover(None, None, 0.0, ())


def test_a_name_that_a_smooth_function_beats_is_doubted_and_has_it_for_a_rival():
    found = left_of(pulled("rough"), ("viscous", "pivot"))
    assert (found.doubted, found.instead) == (("viscous@pivot",), {"viscous@pivot": 1.0})


def test_a_smooth_function_is_one_everywhere_where_its_weights_are():
    made = prepare(rod())
    fit = smooth(made.track, made.begun, made.noise)
    tried = {own.effect.name: own for own in smooth_functions(fit)}
    assert set(tried) == {
        "position", "speed", "time", "load", "friction with position", "friction with time", "friction with load",
        "damping with position", "damping with time", "gain with position", "gain with time",
        "sway with push along x", "sway with push along z",
    }  # fmt: skip
    own = tried["position"]
    np.testing.assert_allclose(own.effect.law(None, own.site, **dict.fromkeys(own.names, 2.0)), 2.0)


def test_a_body_without_a_name_may_be_pushed():
    xml = ARM.replace(' name="upper"', "").replace(' name="lower"', "")
    made = prepare(record(xml, ("q1", "q2"), [waves(60, [1.0, 0.3], 0)], 1e-3, fine=5))
    fit = smooth(made.track, made.begun, made.noise)
    assert [own.site for own in smooth_functions(fit) if own.effect.name == "push with time"] == ["1"]


def test_what_an_impact_leaves_is_not_said_to_be_left():
    starts = [([0, 0, 0.2, 1, 0, 0, 0], [0.3, 0, 0, 0, 0, 0])]
    seen = tuple(f"place[{i}]" for i in range(3))
    made = prepare(record(BALL, seen, [np.zeros((60, 0))], 5e-4, starts=starts, fine=5))
    fit = smooth(made.track, made.begun, made.noise)
    begins_or_ends = fit.levels.mode == CHANGE
    assert begins_or_ends.any() and not begins_or_ends.all()
    for own in smooth_functions(fit):
        told = own.effect.law(None, own.site, **dict.fromkeys(own.names, 1.0))
        assert not told[begins_or_ends].any() and told[~begins_or_ends].any(), own.name
