"""What is missing is named at its places with its values, and nothing else; where nothing is missing, nothing is."""

import copy
from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest
from recorded import ROD, arm, record, rod, rub, waves

from fimpact.deciding import NOTHING, SHARE
from fimpact.diagnosis import pipeline
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.recordings import Recording, Unknown
from fimpact.selection import servo_drives
from fimpact.selection.explanation import Explanation, explain
from fimpact.selection.forward import Search
from fimpact.selection.options import options
from fimpact.selection.regression import Estimate, Regression
from fimpact.smoothing.candidates import at
from fimpact.smoothing.columns import columns, motion_scales
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

SUSPECTS = tuple(
    "coulomb viscous quadratic_damping rotor_inertia gain torque_offset command_delay sensor_bias com_shift "
    "gravity_scale payload".split()
)
FRICTION, DAMPING = (0.15, 0.06), (0.06, 0.03)


@cache
def explained(make, *given, suspects: tuple[str, ...] = SUSPECTS) -> Explanation:
    """What is found among `suspects`; none: in the whole catalogue."""
    made = prepare(make(*given))
    return explain(made.track, made.begun, made.noise, [EFFECTS[name] for name in suspects or EFFECTS])


def names(found: Explanation) -> set[str]:
    return {law.name for law in found.final.placed}


def intervals(found: Explanation) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of every number."""
    p = len(found.final.numbers)
    regression = Regression(found.final, columns(found.final, []))
    own = regression.covariance(Estimate(tuple(range(p)), np.zeros(p), 0.0))
    told = zip(found.final.numbers, np.sqrt(np.diag(own)), strict=True)
    return {f"{n.name} of {n.of}": (n.value, float(sd * n.slope)) for n, sd in told}


def test_friction_at_both_joints_is_named_with_its_values_and_nothing_else():
    found = explained(arm, FRICTION, DAMPING)
    both = {f"{effect}@{joint}" for effect in ("coulomb", "viscous") for joint in ("shoulder", "elbow")}
    assert names(found) == both and found.final.converged and not found.slight
    told = intervals(found)
    for joint, friction, damping in zip(("shoulder", "elbow"), FRICTION, DAMPING, strict=True):
        for name, truth in ((f"friction of coulomb@{joint}", friction), (f"damping of viscous@{joint}", damping)):
            value, sd = told[name]
            assert abs(value - truth) < 3 * sd + 0.002 * truth and sd < 0.1 * truth, name
    assert told["mass of mass@upper"][0] == pytest.approx(0.5, rel=0.02)


def test_where_nothing_is_missing_nothing_is_named():
    for found in (explained(arm), explained(rod, suspects=())):
        assert names(found) == set()
        assert found.p > 0.01 and found.rounds[0].chosen is None


def test_an_effect_of_a_class_is_pruned_to_where_it_is():
    found = explained(arm, (0.15, 0.0))
    assert names(found) == {"coulomb@shoulder"}
    assert intervals(found)["friction of coulomb@shoulder"][0] == pytest.approx(0.15, rel=0.02)


def test_where_next_to_nothing_is_missing_little_takes_no_share_of_it():
    made = prepare(arm((0.15, 0.0)))
    state = Search(made.track, made.begun, made.noise, [EFFECTS["coulomb"]], lambda line: None)
    (whole,) = state.whole(state.current, SHARE)
    shoulder, elbow = whole / (state.naive.tau**2).sum(0)
    assert shoulder == pytest.approx(1) and elbow > 10
    assert np.sqrt(whole[1] / made.track.count) == pytest.approx(NOTHING * state.scales.force[1])


def offset_rod() -> Recording:
    """Dry friction, and beside it a constant torque far smaller."""

    def pull(model, data):
        return np.array([0.012])

    return record(ROD, ("angle",), [waves(300, [0.5], i) for i in range(2)], 3e-4, rub([0.15]), pull, fine=20)


def test_a_small_refinement_enters_behind_what_it_refines():
    found = explained(offset_rod)
    assert [law.name for law in found.final.placed] == ["coulomb@pivot", "torque_offset@motor"]
    assert found.final.placed[1].values["offset"] == pytest.approx(0.012, rel=0.15)
    assert not found.slight  # it takes nearly all that friction had left, though that was little


@cache
def asked(sign: float) -> tuple[Regression, int]:
    """A regression of data that hold viscous friction of this sign, and the column of it."""
    made = prepare(replace(arm(), unknowns=()))
    smoothed = smooth(made.track, made.begun, made.noise)
    scales = motion_scales(smoothed)
    tried = [own for j in ("shoulder", "elbow") for own in at(EFFECTS["viscous"], j, made.track.model, scales)]
    found = columns(smoothed, tried)
    innovations = found.innovations.copy()
    innovations[:, :, 0] += sign * 0.5 * found.innovations[:, :, 1]
    return Regression(smoothed, replace(found, innovations=innovations)), 0


@pytest.mark.parametrize(("sign", "kept"), [(1.0, True), (-1.0, False)])
def test_what_has_a_sign_that_physics_forbids_leaves(sign, kept):
    regression, column = asked(sign)
    assert (column in regression.proper([0, 1]).kept) == kept
    assert (regression.solve([0]).values[0] > 0) == kept


def test_what_a_stretch_would_have_is_from_all_that_are_not_near_it():
    regression, _ = asked(1.0)
    found = regression.solve([0, 1])
    elsewhere = regression.elsewhere(found)
    assert elsewhere.shape == (regression.count, 2)
    changes = np.flatnonzero(np.diff(regression.stretch))
    assert len(changes) + 1 == regression.count >= 10
    others = copy.copy(regression)
    others.__dict__.pop("whole", None)
    near = np.flatnonzero(regression.near[0])
    assert list(near) == ([0, 1] if regression.dispersion > 1 else [0])
    others.gram, others.right = (np.delete(own, near, 0) for own in (others.gram, others.right))
    np.testing.assert_allclose(elsewhere[0], others.solve([0, 1], regression.dispersion).values, rtol=1e-6)


def test_neighbours_are_left_out_too_where_what_is_left_is_no_white_noise():
    regression, _ = asked(1.0)
    first, last = regression.stretch[[part.start for part in regression.smoothed.track.slices()]], []
    for dispersion in (1.0, 1.5):
        own = copy.copy(regression)
        own.__dict__.pop("near", None)
        own.__dict__["dispersion"] = dispersion
        last.append(own.near)
    np.testing.assert_array_equal(last[0], np.eye(regression.count))
    assert (last[1].sum(1) <= 3).all() and (np.diag(last[1]) == 1).all()
    for begin in first[1:]:  # another run is another recording
        assert last[1][begin, begin - 1] == 0 and last[1][begin, begin + 1] == 1


def test_the_error_of_a_stretch_is_that_of_values_from_the_others():
    regression, _ = asked(1.0)
    found = regression.solve([0, 1])
    rows = regression.columns.innovations
    values = regression.elsewhere(found)[regression.stretch]
    left = rows[:, :, 0] - np.einsum("kac,kc->ka", rows[:, :, 1:3], values)
    expected = np.bincount(regression.stretch, (left**2).sum(1), regression.count)
    np.testing.assert_allclose(regression.errors(found), expected, rtol=1e-8)
    assert len(set(map(tuple, values))) == regression.count


def test_hypotheses_are_classes_first_then_places_alone():
    made = prepare(arm())
    smoothed = smooth(made.track, made.begun, made.noise)
    tried = [
        own
        for effect in ("coulomb", "viscous", "rotor_inertia")
        for joint in ("shoulder", "elbow")
        for own in at(EFFECTS[effect], joint, made.track.model, motion_scales(smoothed))
    ]
    found = options(made.track.model, made.track.recording.channels, tried)
    assert found[0].compound and sorted(found[0].members) == list(range(6))
    assert {option.members for option in found[1:]} == {(0, 1), (2, 3), (4, 5), *((i,) for i in range(6))}


# ---- what users have sent

ON_ONE_JOINT = tuple(
    "coulomb viscous stribeck load_dependent_friction rotor_inertia gain saturation servo_kp servo_kv command_delay "
    "sensor_bias torque_offset com_shift quadratic_damping".split()
)

LOADED = """<mujoco><option timestep="0.002"/><worldbody><body name="bench"><joint name="j1" axis="0 1 0" damping="0.02"
armature="0.01"/><geom type="capsule" fromto="0 0 0 0 0 -0.15" size="0.01" mass="0.02" contype="0" conaffinity="0"/>
<geom type="sphere" pos="0 0 -0.15" size="0.02" mass="0.6" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor name="m" joint="j1"/></actuator><sensor><jointpos name="q" joint="j1"/></sensor></mujoco>"""
SERVO = """<mujoco><option timestep="{step}"/><worldbody><body name="link"><joint name="j1" axis="0 1 0" damping="0.05"
armature="{rotor}"/><geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.015" mass="0.5" contype="0" conaffinity="0"/>
</body></worldbody><actuator><position name="s1" joint="j1" {servo}/></actuator>
<sensor><jointpos name="q" joint="j1"/></sensor></mujoco>"""
UNKNOWNS = (Unknown("mass", "link", 0.1), Unknown("damping", "j1", 0.5))


def loaded() -> Recording:
    """0.03 N m of dry friction and 0.12 of the torque that the gear carries."""

    def pull(model, data):
        model.dof_frictionloss[0] = 0.03 + 0.12 * abs(data.ctrl[0])
        return np.zeros(1)

    commands = [waves(400, [1.0], i) for i in range(2)]
    unknowns = (Unknown("mass", "bench", 0.05), Unknown("damping", "j1", 0.5))
    return record(LOADED, ("q",), commands, 1e-3, rub([0.03]), pull, unknowns, fine=20)


def coarse() -> Recording:
    """A stiff servo whose MJCF has a time step of 10 ms, recorded as it really moves."""
    xml = SERVO.format(step=0.01, rotor=0.004, servo='kp="60" kv="0.2"')
    return record(xml, ("q",), [waves(400, [0.5], i) for i in range(2)], 1e-3, unknowns=UNKNOWNS)


def limited() -> Recording:
    """A servo that gives 1.1 N m, and not 4 as its MJCF says."""

    def hide(model):
        model.actuator_forcerange[0] = -1.1, 1.1

    xml = SERVO.format(step=0.002, rotor=0.0, servo='kp="25" kv="0.6" forcerange="-4 4"')
    return record(xml, ("q",), [waves(400, [0.8], i) for i in range(2)], 1e-3, hide, unknowns=UNKNOWNS)


def test_friction_that_grows_with_the_load_is_told_from_plain_friction():
    found = explained(loaded, suspects=ON_ONE_JOINT)
    law = [own for own in found.final.placed if own.name == "load_dependent_friction@j1"]
    others = [{own.name for own in a.placed} for a in found.alternatives]
    assert law or {"load_dependent_friction@j1"} in others
    assert names(found) <= {"load_dependent_friction@j1", "coulomb@j1"}
    assert not law or law[0].values["coefficient"] == pytest.approx(0.13, abs=0.03)


def test_a_coarse_time_step_is_nothing_that_is_missing():
    assert names(explained(coarse, suspects=ON_ONE_JOINT)) == set()


def test_a_torque_limit_is_found_where_it_is():
    found = explained(limited, suspects=ON_ONE_JOINT)
    assert names(found) == {"saturation@s1"}
    assert found.final.placed[0].values["limit"] == pytest.approx(1.1, rel=0.03)


def test_placed_effects_are_named_by_place():
    assert Placed(EFFECTS["coulomb"], "elbow", {"friction": 1.0}).name == "coulomb@elbow"


@pytest.fixture
def restless(monkeypatch):
    """No fit with dry friction comes to rest."""
    refitted = Search.refitted

    def never(self, regression, trial, out=()):
        fit = refitted(self, regression, trial, out)
        rubs = any(law.effect.name == "coulomb" for law in fit.placed)
        return replace(fit, converged=False) if rubs else fit

    monkeypatch.setattr(Search, "refitted", never)
    asked = servo_drives.refitted_with

    def nor_there(search, tried, *given):
        fit = asked(search, tried, *given)
        return replace(fit, converged=False) if any(own.effect.name == "coulomb" for own in tried) else fit

    monkeypatch.setattr(servo_drives, "refitted_with", nor_there)


def test_what_no_fit_settles_with_is_not_nothing(restless):
    found = explained(rod, 0.15, suspects=("coulomb",))
    assert not found.final.placed and [t.option.name for t in found.unfitted] == ["coulomb@pivot"]
    with patch.object(pipeline, "explain", lambda *given: found):
        told = pipeline.diagnose(rod(0.15), brief=True)
    assert told.answer == pipeline.UNNAMED
    assert "coulomb at pivot" in told.verdict and "no fit with it settles" in told.verdict


def test_what_no_fit_settles_with_is_a_rival_of_what_takes_its_place(restless):
    found = explained(rod, 0.15, suspects=("coulomb", "viscous"))
    assert names(found) == {"viscous@pivot"} and not found.unfitted
    assert [(tuple(law.name for law in own.placed), own.weight) for own in found.alternatives] == [
        (("coulomb@pivot",), 1.0)
    ]


def test_a_fit_that_comes_to_nothing_keeps_no_question_from_being_asked(restless):
    made = prepare(rod(0.15))
    state = Search(made.track, made.begun, made.noise, [EFFECTS["coulomb"]], lambda line: None)
    before = state.spent
    state.round()
    assert state.unfitted and state.spent == before
