"""What one more run says of explanations, which run would say most, and what a robot needs to play it."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pandas as pd
import pytest
from diagnosed import rubbing, undecided
from planted import record

from fimpact.diagnosis.experiments.design_space import DesignSpace, limits
from fimpact.diagnosis.experiments.next_experiment import MANY, contenders, described, next_experiment, write_experiment
from fimpact.diagnosis.experiments.predicted_separation import (
    MOST,
    PIECES,
    PriorKnowledge,
    fitted_information,
    non_absorbed,
    separations,
    unknown_information,
)
from fimpact.diagnosis.experiments.resolve import Resolved, ranked, resolve
from fimpact.diagnosis.experiments.separating import (
    ENOUGH_SEPARATION,
    GENERATIONS,
    MIN_GENERATIONS,
    NEEDED,
    PATIENCE,
    Experiment,
    best_design,
    discriminate,
    repeats,
    utility,
)
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.report.experiment_picture import commands
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator

FRICTION, NOISE = 0.004, np.full(2, 2e-4)  # N m, rad
COULOMB = {"coulomb@joint_2": {"friction": FRICTION}}
OFFSET = {"torque_offset@motor_2": {"offset": 0.001}}


@cache
def recording():
    return record(3, lambda model: model.dof_frictionloss.__setitem__(1, FRICTION))


@cache
def known() -> PriorKnowledge:
    simulator = Simulator(recording())
    members = tuple(Hypothesis(simulator.theta, (_placed(m),)) for m in (COULOMB, OFFSET))
    return PriorKnowledge(simulator, members, NOISE, np.zeros(2), unknown_information(simulator, simulator.theta))


def _placed(member):
    ((name, values),) = member.items()
    effect, _, site = name.partition("@")
    return Placed(EFFECTS[effect], site, values)


@cache
def designs(count: int = 3):
    allowed = limits(recording(), known().simulator.base, NOISE)
    drawn = [allowed.unpack(design) for design in allowed.draw(np.random.default_rng(0), count)]
    return [np.array(part) for part in zip(*drawn, strict=True)]


@cache
def designed() -> Experiment:
    return next_experiment(undecided())


def test_a_further_run_leaves_what_is_there():
    found, left = resolve(recording(), recording().held_out[:1], ["torque_offset@motor_2"])
    assert found[0].name == left[0] == "coulomb@joint_2" and found[0].weight > 0.5
    assert found[-1] == Resolved("torque_offset@motor_2", 0.0)


def test_where_no_name_is_left_that_is_what_is_left():
    nothing = SimpleNamespace(members=(), answer="none")
    assert ranked(nothing, ["spring@joint_2"]) == [Resolved("none", 1.0), Resolved("spring@joint_2", 0.0)]


def test_the_missing_force_hides_what_separates():
    quiet = separations(known(), *designs())
    loud = separations(replace(known(), force=np.full(2, 0.02)), *designs())
    assert quiet.shape == (3, 1) and (quiet > 0).all() and (loud < 0.5 * quiet).all()


def test_what_the_unknowns_may_be_separates_nothing():
    """The same effect with another damping, which nothing is known of, is the same explanation."""
    first = known().members[0]
    other = replace(first, theta=first.theta * [1, 1, 1, 1.001])
    told = replace(known(), members=(first, other))
    fixed = separations(replace(told, information=1e12 * np.eye(4)), *designs())
    assert (separations(replace(told, information=np.zeros((4, 4))), *designs()) < 1e-2 * fixed).all()


def test_information_on_unknowns_is_what_effects_leave():
    whole = np.array([[2.0, 1.0], [1.0, 1.0]])
    assert fitted_information(whole, [-1, 0]) == pytest.approx(np.array([[1.0]]))


def test_an_experiment_that_diverges_separates_nothing():
    wild = Hypothesis(known().simulator.theta, (_placed({"quadratic_drag@link_2": {"coefficient": -1e9}}),))
    assert not separations(replace(known(), members=(known().members[0], wild)), *designs()).any()


def test_no_piece_of_a_run_alone_separates():
    wild = np.zeros((1, 4 * PIECES))
    wild[0, :4] = 1e6
    assert non_absorbed(wild, np.zeros((1, 1, 4 * PIECES)), np.eye(1)) == pytest.approx([MOST])


def test_the_design_is_no_worse_than_random(monkeypatch):
    monkeypatch.setattr("fimpact.diagnosis.experiments.separating.GENERATIONS", 2)
    found = discriminate(recording(), known().simulator, known().members, NOISE)
    assert found.separation >= found.random > 0 and len(found.ctrl) == 240


def moved_by(motors: int) -> mujoco.MjModel:
    """A sled with so many motors."""
    motor = '<motor joint="rail"/>' * motors
    return mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="rail" type="slide"/><geom size="0.1"/></body></worldbody>'
        f"<actuator>{motor}</actuator></mujoco>"
    )


@pytest.mark.parametrize(("value", "searched"), [(2 * ENOUGH_SEPARATION, 0), (ENOUGH_SEPARATION / 2, PATIENCE + 1)])
def test_a_search_ends_when_more_is_not_needed_or_not_found(value, searched):
    calls, allowed = [], DesignSpace(np.zeros(3), np.ones(3), 5, moved_by(0))

    def constant(designs):
        calls.append(len(designs))
        return np.full((len(designs), 1), value)

    found, pairs = best_design(constant, allowed, np.full(3, 0.5), np.array([value]), 0)
    assert len(calls) == searched and pairs == [value] and found == pytest.approx([0.5] * 3)


def test_a_search_that_finds_nothing_worth_playing_ends_early():
    values = iter(np.logspace(-6, -3, GENERATIONS))
    allowed = DesignSpace(np.zeros(3), np.ones(3), 5, moved_by(0))
    _, pairs = best_design(
        lambda designs: np.full((len(designs), 1), next(values)), allowed, np.zeros(3), np.array([1e-9]), 0
    )
    assert pairs == [np.logspace(-6, -3, GENERATIONS)[MIN_GENERATIONS - 1]]


def test_a_pair_that_nothing_separates_does_not_decide():
    assert np.argmax(utility(np.array([[0.1, 5.0], [0.1, 50.0], [0.2, 5.0]]))) == 1


def test_commands_go_gently_or_at_once_from_knot_to_knot():
    knots = np.tile([[0.0], [1.0]], (4, 1)).ravel()
    allowed = DesignSpace(np.zeros(13), np.ones(13), 71, moved_by(1))
    gently, at_once = (allowed.unpack(np.append(knots, [part, 0, 0, 0, 0]))[0][:, 0] for part in (1.0, 0.02))
    assert np.diff(gently) == pytest.approx(np.tile(np.repeat([0.1, -0.1], 10), 4)[:70])
    assert set(np.unique(at_once)) == {0.0, 0.5, 1.0}


def test_a_thrown_body_has_no_commands():
    allowed = DesignSpace(np.array([1.0, 0.0, 2.0, 3.0]), np.array([1.0, 1.0, 2.0, 3.0]), 5, moved_by(0))
    ctrl, qpos, qvel = allowed.unpack(allowed.low)
    assert ctrl.shape == (5, 0) and qpos.tolist() == [2.0] and qvel.tolist() == [3.0]


def test_a_free_body_is_thrown_from_an_orientation():
    xml = "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    ends = np.r_[0.1, 0, np.zeros(3), -np.ones(4), np.zeros(6)], np.r_[1.0, 1, np.ones(3), np.ones(4), np.ones(6)]
    allowed = DesignSpace(*ends, 5, mujoco.MjModel.from_xml_string(xml))
    for design in allowed.draw(np.random.default_rng(0), 5):
        _, qpos, qvel = allowed.unpack(design)
        assert np.linalg.norm(qpos[3:]) == pytest.approx(1.0)
        assert qpos[:3].tolist() == design[2:5].tolist() and qvel.tolist() == design[9:].tolist()


def test_square_waves_stay_within_the_limits_and_random_experiments_have_none():
    bounds = np.append(np.full(8, -1.0), [0.02, 0, 0, 0, 0]), np.append(np.full(8, 2.0), [1.0, 1, 1, 0, 0])
    allowed, rng = DesignSpace(*bounds, 64, moved_by(1)), np.random.default_rng(0)
    flat = np.append(np.full(8, 0.5), [1.0, 0.5])
    slow, quick = (allowed.unpack(np.append(flat, [pace, 0, 0]))[0][:, 0] for pace in (0.0, 1.0))
    assert slow == pytest.approx(np.repeat([1.25, -0.25], 32)) and np.abs(np.diff(quick)).sum() == 31 * 1.5
    waved = np.array([allowed.unpack(design)[0] for design in allowed.draw(rng, 20, waves=True)])
    assert waved.min() >= -1.0 and waved.max() <= 2.0
    assert not allowed.draw(rng, 20)[:, 9].any()


def test_one_name_needs_no_experiment():
    assert next_experiment(rubbing()) is None


def test_the_files_hold_commands_and_start_within_what_was_recorded(tmp_path):
    write_experiment(undecided(), designed(), tmp_path)
    played = pd.read_csv(tmp_path / "experiment.csv", index_col="time")
    begin = pd.read_csv(tmp_path / "experiment-start.csv")
    assert begin.quantity.tolist() == ["qpos", "qvel"] and begin.of.tolist() == ["pivot", "pivot"]
    assert begin.value.tolist() == pytest.approx([designed().qpos[0], designed().qvel[0]], rel=1e-6)
    recorded = np.concatenate([run.ctrl for run in undecided().recording.training])
    low, high = recorded.min(), recorded.max()
    assert low - 1e-6 <= played.motor.min() < played.motor.max() <= high + 1e-6
    assert np.diff(played.index) == pytest.approx(undecided().recording.period)
    told = described(undecided(), designed())
    assert told["pairs"][0]["separation"] == designed().separation > NEEDED
    assert [(p["one"], p["other"]) for p in told["pairs"]] == [("coulomb@pivot", "viscous@pivot")]
    assert len(commands(undecided(), designed()).axes) == 1


def test_where_none_would_help_no_file_is_written():
    hopeless = replace(designed(), pairs=np.array([NEEDED / (MANY + 1)]))
    assert repeats(hopeless.separation) == MANY + 1 and described(undecided(), hopeless)["files"] == []


def test_a_pair_that_nothing_tells_apart_does_not_spoil_the_others():
    third = replace(undecided().members[1], name="viscous@other")
    three = replace(undecided(), members=(*undecided().members, third))
    found = Experiment(np.zeros((3, 1)), np.zeros(1), np.zeros(1), 0.01, np.array([30.0, 0.0, 4.0]), 0.1)
    told = described(three, found)
    assert [pair["repeats"] for pair in told["pairs"]] == [1, None, 3] and told["files"]


def test_unlikely_members_are_not_told_apart():
    rare = replace(undecided(), members=(undecided().members[0], replace(undecided().members[1], weight=0.01)))
    assert len(contenders(rare)) == 1
