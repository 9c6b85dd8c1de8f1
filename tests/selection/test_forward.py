"""A search takes what is surely better, begins compounds everywhere, and ends where it has cost enough."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from recorded import rod

from fimpact.deciding import BELIEF, CONFIDENCE, SHARE, TYPICAL
from fimpact.effects import EFFECTS
from fimpact.selection import explanation, forward
from fimpact.selection.chance import least
from fimpact.selection.explanation import explain
from fimpact.selection.forward import Search
from fimpact.selection.one_round import Trial, attempt, search
from fimpact.selection.options import Option, joint_at
from fimpact.selection.regression import Estimate, Regression
from fimpact.selection.servo_drives import refitted_whole
from fimpact.smoothing.candidates import Candidate
from fimpact.smoothing.columns import Columns
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.stretches import spread_of_scores

COUNT, LENGTH = 1000, 25  # samples, and samples in a stretch


def candidate(effect: str, site: str, sd: float = 1.0) -> Candidate:
    return Candidate(EFFECTS[effect], site, {}, ("size",), (sd,), (False,), {}, {}, {"size": sd})


def regression(planted: dict[int, float], columns: np.ndarray, noise: float = 1.0) -> Regression:
    """Data that hold so much of some `columns`, (N, c), and white noise; of each column, a candidate at a joint."""
    rng, count = np.random.default_rng(0), columns.shape[1]
    data = noise * rng.standard_normal(COUNT) + sum(size * columns[:, i] for i, size in planted.items())
    rows = np.concatenate([data[:, None], columns], 1)[:, None]
    track = SimpleNamespace(count=COUNT, slices=lambda: [slice(0, COUNT)])
    levels = SimpleNamespace(summed=lambda squared: squared.sum(0)[None])
    smoothed = SimpleNamespace(
        numbers=(), placed=(), count=COUNT, track=track, tau=rng.standard_normal((COUNT, 1)), levels=levels
    )
    tried = tuple(candidate("viscous", f"j{i}") for i in range(count))
    return Regression(smoothed, Columns(rows, rows, tried, tuple((i, 0) for i in range(count))))


def white(count: int) -> np.ndarray:
    return np.random.default_rng(1).standard_normal((COUNT, count))


def alone(count: int) -> list[Option]:
    return [Option(f"viscous@j{i}", 1, (i,)) for i in range(count)]


def found(own: Regression, offered: list[Option]):
    return search(own, offered, (own.columns.forces[:, :, 0] ** 2).sum(0)[None], SHARE)


def tried(own: Regression, option: Option) -> Trial | None:
    now = own.proper(range(own.p))
    missing = (own.columns.forces[:, :, 0] ** 2).sum(0)[None]
    return attempt(own, now, own.errors(now), own.forces_left(now, own.white), missing, option, 1)


def test_however_little_is_named_where_it_is_certain():
    """Whether it is something to an engineer is said of the finding, not decided by the search."""
    own = regression({0: 1e-4}, 1e4 * white(1), 1e-3)
    assert found(own, alone(1)).chosen.estimate.values[0] == pytest.approx(1e-4, rel=1e-3)


def test_what_is_fitted_takes_no_more_than_it_would_of_what_is_predicted():
    shares = []
    for dispersion in (1.0, 1.0 + 1e-9):  # fitted to all stretches, and to those elsewhere
        own = regression({0: 0.2}, white(1))
        own.__dict__["dispersion"] = dispersion
        shares.append(tried(own, alone(1)[0]).share)
    assert shares[0] == pytest.approx(shares[1], rel=0.05)


def test_what_does_nothing_is_not_chosen():
    own = regression({}, white(3))
    result = found(own, alone(3))
    assert result.chosen is None and len(result.tried) == 3


def test_a_gain_is_sure_where_few_stretches_gain_much_and_the_rest_a_little():
    """A standard error would take the two large ones for doubt; one alone may be an accident."""
    little = np.full(28, 0.4)
    better = np.r_[19.0, 15.0, little]
    assert better.sum() < BELIEF * better.std() * np.sqrt(len(better))
    assert 0 < least(better) < little.sum() + 15
    assert least(np.r_[60.0, np.tile([1.0, -1.0], 14)]) < 0
    assert least(-better) < -better.sum()
    assert least(better) == pytest.approx(least(better[::-1]), rel=0.1)


def bursts() -> np.ndarray:
    """A column that is everywhere, and one that is loud in a few stretches and nowhere else."""
    columns = white(2)
    loud = np.isin(np.arange(COUNT) // LENGTH % 10, (4,))
    columns[:, 1] *= np.where(loud, 10.0, 0.1)
    return columns


def test_what_gains_most_comes_first_though_in_few_stretches():
    own = regression({0: 0.6, 1: 0.27}, bursts())
    result = found(own, alone(2))
    everywhere, burst = (next(t for t in result.tried if t.option.members == (i,)) for i in (0, 1))
    assert burst.gain > everywhere.gain > 0 and burst.error > everywhere.error
    assert [t.gain for t in result.tried] == sorted((t.gain for t in result.tried), reverse=True)


@pytest.mark.parametrize("shown", [(7, 30), (7,)])
@pytest.mark.parametrize(("before", "beside", "chosen"), [(1.0, 1.0, True), (1.5, 1.2, True), (1.5, 1.5, False)])
def test_what_shows_in_few_stretches_only_is_named_where_the_rest_is_white_noise(before, beside, chosen, shown):
    """Elsewhere it may be an accident of what is left: other stretches might have shown nothing."""
    columns = white(1) * np.isin(np.arange(COUNT) // LENGTH, shown)[:, None]
    own = regression({0: 2.0}, columns)
    own.__dict__.update(dispersion=before, spread=lambda found: beside)
    result = found(own, alone(1))
    assert result.tried[0].sure < 0 and (result.chosen is not None) == chosen


def test_white_noise_looks_so_as_often_as_it_should():
    """The scores of one column of white noise, in 40 stretches, vary by more than half a time in one of twenty."""
    own, rng = regression({}, white(1)), np.random.default_rng(3)
    spreads = [spread_of_scores(rng.standard_normal((own.count, 1)), np.array([float(own.count)])) for _ in range(2000)]
    assert np.mean([own.looks_white(spread) for spread in spreads]) == pytest.approx(CONFIDENCE, abs=0.015)
    assert not own.looks_white(1.5)


def test_what_acts_everywhere_is_to_be_borne_out_by_other_stretches():
    """However white the rest is beside it: they were asked."""
    acting = {1: [3], 4: [3, 9, 20, 33], COUNT: range(COUNT)}
    for stretches, where in acting.items():
        own = regression({0: 2.0}, white(1) * np.isin(np.arange(COUNT) // LENGTH, where)[:, None])
        own.__dict__.update(dispersion=1.5, spread=lambda found: 1.0)
        trial = tried(own, alone(1)[0])
        assert trial.trusted == (stretches == 1 and trial.sure <= 0)
        assert stretches > 1 or trial.trusted


def test_what_an_effect_takes_is_counted_by_contact_mode():
    """A twentieth of the samples touch; of all that is missing its force is nothing, of what is missing there much."""
    touches = np.arange(COUNT) % 20 == 0
    columns = white(1) * touches[:, None]
    own = regression({0: 1.5}, columns)
    data = own.columns.forces[:, 0, 0]
    for modes in ([np.ones(COUNT)], [~touches, touches]):
        summed = lambda squared, modes=modes: np.array(modes, float) @ squared  # noqa: E731
        own.smoothed.levels.summed = summed
        missing = np.maximum(summed(data[:, None] ** 2), 1e2 * COUNT * (len(modes) == 1))
        told = search(own, alone(1), missing, SHARE)
        assert (told.chosen is not None) == (len(modes) == 2)
        assert told.tried[0].place == (len(modes) - 1, 0)


def test_of_what_is_as_good_the_earlier_in_the_engineers_order_is_chosen():
    columns = white(1) @ np.ones((1, 2)) + 1e-3 * np.random.default_rng(2).standard_normal((COUNT, 2))
    own = regression({0: 0.5}, columns)
    offered = [replace(option, order=order) for option, order in zip(alone(2), (3, 1), strict=True)]
    result = found(own, offered)
    assert result.chosen.option is offered[1]
    assert [trial.option for trial, _ in result.rivals] == [offered[0]]
    assert result.rivals[0][1] == pytest.approx(1, abs=0.5)


def test_of_what_is_as_good_and_as_early_the_simpler_is_chosen():
    own = regression({0: 0.5, 1: 0.025}, white(2))
    offered = [Option("both", 1, (0, 1)), alone(2)[0]]
    result = found(own, offered)
    assert result.tried[0].option is offered[0]  # by a hair
    assert result.chosen.option is offered[1]


def test_what_added_nothing_to_a_class_is_dropped_from_it():
    own = regression({0: 0.5}, white(2))
    result = found(own, [Option("all joints", 1, (0, 1))])
    assert result.chosen.estimate.kept == (0,)


# ---- compounds


def refits(option: Option, kept: dict[int, float], coupled: bool = False, converges: bool = True) -> list[Trial]:
    """Trials that are refitted for one in which these columns were kept, after one number of the fit."""
    members = [candidate("coulomb", "a", 2.0), candidate("coulomb", "b", 8.0), candidate("viscous", "a", 0.1)]
    members.append(candidate("viscous", "other", 0.05))
    columns = SimpleNamespace(candidates=members, owners=tuple((i, 0) for i in range(len(members))))
    estimate = Estimate(tuple(kept), np.array(list(kept.values())), 0.0)
    trial, made = Trial(option, estimate, 0.0, 1.0, 0.1, 0.8, 1.0, (0, 0), np.zeros(1)), []

    def refitted(regression, own):
        made.append(own)
        return SimpleNamespace(converged=converges)

    refitted_whole(SimpleNamespace(coupled=coupled, refitted=refitted), SimpleNamespace(p=1, columns=columns), trial)
    return made


def values_of(trial: Trial) -> dict[int, float]:
    return dict(zip(trial.estimate.kept, trial.estimate.values, strict=True))


DRIVES = Option("geared drive", 0, (0, 1, 2), True)


@pytest.mark.parametrize("coupled", [True, False])
def test_a_compound_begins_with_all_of_its_members(coupled):
    (begun,) = refits(DRIVES, {0: 0.3, 1: 0.9}, coupled)
    values = values_of(begun)
    assert values[0] == 0.3  # the number of the fit
    assert values[1] == 0.9  # what the regression says, where that is more
    assert values[2] * 8.0 == pytest.approx(TYPICAL * 2.0)  # the size that is typical where it is least
    assert values[3] == pytest.approx(TYPICAL)
    assert 4 not in values  # no member, though its prior is the least


def test_a_member_that_is_less_than_typical_begins_there():
    values = values_of(refits(DRIVES, {0: 0.3, 1: 1e-3, 2: 2.0})[0])
    assert values[1] == pytest.approx(TYPICAL) and values[2] == 2.0


def test_a_compound_that_does_not_converge_begins_with_what_the_regression_has_but_under_servos():
    whole, plain = refits(DRIVES, {0: 0.3, 1: 0.9}, converges=False)
    assert set(values_of(whole)) == {0, 1, 2, 3} and values_of(plain) == {0: 0.3, 1: 0.9}
    assert len(refits(DRIVES, {0: 0.3, 1: 0.9}, coupled=True, converges=False)) == 1


def test_one_kind_begins_where_the_regression_has_it():
    (begun,) = refits(replace(DRIVES, compound=False), {0: 0.3, 1: 0.9})
    assert values_of(begun) == {0: 0.3, 1: 0.9}


# ---- the budget


@pytest.mark.parametrize(("rounds", "names"), [(0, []), (1, ["coulomb@pivot"])])
def test_the_budget_ends_a_search(monkeypatch, rounds, names):
    made, asked = prepare(rod(0.15), refine=1), []
    plain, begun = Search.round, Search.__init__

    def counted(self):
        asked.append(self.spent)
        return plain(self)

    def narrow(self, *args):
        begun(self, *args)
        monkeypatch.setattr(forward, "BUDGET", self.spent + (1.0 if rounds else 0.0))

    monkeypatch.setattr(Search, "round", counted)
    monkeypatch.setattr(Search, "__init__", narrow)
    result = explain(made.track, made.begun, made.noise, [EFFECTS["coulomb"], EFFECTS["spring"]])
    assert len(asked) == rounds == len(result.rounds)
    assert [law.name for law in result.final.placed] == names
    assert (result.final is result.naive) == (not rounds)
    assert made.track.quanta > forward.BUDGET or not rounds


@pytest.mark.parametrize(("drops", "rounds"), [(False, 1), (True, 2)])
def test_what_a_part_in_doubt_stood_in_the_way_of_is_asked_once_it_has_gone(monkeypatch, drops, rounds):
    made, asked = prepare(rod(0.15), refine=1), []
    monkeypatch.setattr(Search, "round", lambda self: bool(asked.append(self)))

    def without(state):
        return replace(state.current) if drops else state.current

    monkeypatch.setattr(explanation, "without_doubtful_parts", without)
    explain(made.track, made.begun, made.noise, [EFFECTS["coulomb"]])
    assert len(asked) == rounds


@pytest.mark.parametrize(("alike", "asked"), [(0.97, True), (0.8, False)])
def test_what_is_no_more_than_a_tenth_behind_is_refitted(alike, asked):
    """A column is a tangent: how much an effect explains is not known to better than that."""
    columns = white(2)
    columns[:, 1] = alike * columns[:, 0] + np.sqrt(1 - alike**2) * columns[:, 1]
    made = found(regression({0: 1.0}, columns), alone(2))
    assert made.chosen.places == ("viscous@j0",)
    assert [trial.places for trial, weight in made.rivals if weight < 0.05] == [("viscous@j1",)] * asked


def test_what_holds_all_that_is_chosen_and_more_is_no_rival():
    own = regression({0: 0.8}, white(2))
    result = found(own, [Option("both", 2, (0, 1)), *alone(2)])
    assert result.chosen.option.name == "viscous@j0"
    assert not [trial for trial, _ in result.rivals if "viscous@j0" in trial.places]


def test_a_compound_that_is_far_behind_is_not_chosen():
    own = regression({0: 0.3, 1: 0.3, 2: 0.8}, white(3))
    assert found(own, [Option("drive", 0, (0, 1), True), *alone(3)]).chosen.option.name == "viscous@j2"


def test_the_more_is_offered_the_likelier_is_a_chance():
    own, missing = regression({0: 4.0}, white(1), noise=40.0), np.ones((1, 1))
    once, often = (search(own, alone(1) * count, missing, 0.0).tried[0].p for count in (1, 50))
    assert 1e-9 < once < 0.02 and often == pytest.approx(50 * once)


def test_no_share_is_more_than_all_that_was_missing():
    own = regression({0: 0.8}, white(1))
    little = 1e-3 * (own.columns.forces[:, :, 0] ** 2).sum(0)[None]
    assert search(own, alone(1), little, SHARE).chosen.share == 1.0


@pytest.mark.parametrize(("gain", "chosen"), [(0.0, True), (0.5, False)])
def test_what_only_brings_unknowns_back_to_their_priors_gives_way_to_what_gains_more(gain, chosen):
    """An unknown that data drive far from its prior, a candidate with nearly the same column, and another one."""
    columns = white(3)
    columns[:, 1] = columns[:, 0] + 0.01 * columns[:, 1]
    own = regression({0: 0.25, 2: gain}, columns)
    unknown = SimpleNamespace(place=-1, away=0.0, spread=0.05, log=False, value=0.0, name="mass", of="mass@link")
    smoothed = SimpleNamespace(**{**vars(own.smoothed), "numbers": (unknown,)})
    tried = tuple(candidate("viscous", f"j{i}") for i in range(2))
    own = Regression(smoothed, replace(own.columns, candidates=tried, owners=((0, 0), (1, 0))))
    much = 1e9 * np.ones((1, 1))  # force, of which neither takes a share
    told = search(own, [Option("viscous@j0", 0, (0,)), Option("viscous@j1", 1, (1,))], much, SHARE)
    first = next(t for t in told.tried if t.option.name == "viscous@j0")
    assert first.hidden and first.sure > 0 and (told.chosen is not None) == chosen


def test_no_second_gear_is_offered_where_one_gives():
    state = object.__new__(Search)
    state.current = SimpleNamespace(placed=(SimpleNamespace(effect=EFFECTS["backlash"], site="a", name="backlash@a"),))
    tried = [candidate("joint_elasticity", "a"), candidate("joint_elasticity", "b"), candidate("coulomb", "a")]
    told = [state.is_second_gear(tried, Option("", 0, (i,))) for i in range(3)]
    assert told == [True, False, False]
    assert not state.is_second_gear(tried, Option("", 0, (0,)), out=[0])


ARM_WITH_PARTS = """<mujoco><worldbody><body name="upper"><joint name="shoulder" axis="0 1 0"/>
<geom size="0.1"/><body name="lower" pos="0 0 -1"><joint name="elbow" axis="0 1 0"/><geom size="0.1"/>
<body name="tool"><geom size="0.1"/></body></body></body></worldbody>
<actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("site", "joint"),
    [
        ("elbow", "elbow"),
        ("m1", "shoulder"),
        ("lower", "elbow"),
        ("elbow<-shoulder", "elbow"),
        ("tool", ""),
        ("q1", ""),
    ],
)
def test_a_site_acts_at_its_joint(site, joint):
    assert joint_at(mujoco.MjModel.from_xml_string(ARM_WITH_PARTS), site) == joint


def test_what_a_drive_lost_at_a_joint_is_asked_together_with_what_may_have_kept_it_out():
    model = mujoco.MjModel.from_xml_string(ARM_WITH_PARTS)
    state = object.__new__(Search)
    state.track = SimpleNamespace(model=model, recording=SimpleNamespace(channels=()))
    state.weak, state.parts, state.failed = {"viscous@elbow", "spring@elbow"}, {"viscous@elbow"}, set()
    state.current, state.dropped = SimpleNamespace(placed=()), set()
    state.candidates = [candidate(*own) for own in (("gain", "m1"), ("viscous", "elbow"), ("spring", "elbow"))]
    assert [c.name for c in state.held_back()] == ["viscous@elbow"]
    tried = [candidate("gain", "m1"), candidate("gain", "m2"), *state.held_back()]
    offered = [option for option in state.offered(tried) if len(option.members) > 1 or "@" in option.name]
    assert [option.members for option in offered if 2 in option.members] == [(1, 2)]
    assert [option.members for option in offered if "," not in option.name and "@" in option.name] == [(0,), (1,)]
