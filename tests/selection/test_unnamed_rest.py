"""Physics without a name: where it is and what it follows."""

from functools import cache

import mujoco
import numpy as np
import pytest
from recorded import ARM, BALL, ROD, arm, record, rod, waves

from fimpact.effects import EFFECTS
from fimpact.recordings import Recording
from fimpact.selection.forced import fit_forced
from fimpact.selection.unnamed_rest import Leftover, leftover, smooth_functions
from fimpact.smoothing.noise_levels import CHANGE
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth


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
    assert (found.dof, found.follows) == (0, follows) and found.share > 0.3


def test_a_gain_that_swings_with_the_time_is_told_from_a_force():
    def swings(model, data):
        return 0.02 * np.sin(2 * np.pi * data.time / 1.1) * data.ctrl

    found = left_of(record(ROD, ("angle",), [waves(400, [0.5], i) for i in range(5)], 3e-4, pull=swings, fine=20))
    assert (found.dof, found.follows) == (0, "gain with time") and found.share > 0.3


def test_a_gust_at_a_link_is_one_push_whatever_the_pose():
    """Its torques at the joints are of either sign from run to run."""

    def gust(model, data):
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian, None, model.body("lower").id)
        return 0.3 * np.exp(-(((data.time - 2.0) / 0.3) ** 2)) * np.array([0.8, 0.0, 0.6]) @ jacobian

    commands = [waves(400, [2.0, 0.6], i) for i in range(6)]
    found = left_of(record(ARM, ("q1", "q2"), commands, 5e-4, pull=gust, fine=20))
    assert (found.dof, found.follows) == (1, "push with time") and found.share > 0.3


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
