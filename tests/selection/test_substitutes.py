"""What stands in the place of an effect that is in: likelier, simpler, or nothing."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded import ROD, record, rod, waves
from scipy import stats
from test_forward import COUNT, alone, regression, white

from fimpact.effects import EFFECTS
from fimpact.effects.families.friction import direction_dependent
from fimpact.selection import rivals
from fimpact.selection.forward import Search
from fimpact.selection.one_round import share_of
from fimpact.selection.options import Option, options
from fimpact.selection.pruning import simplified
from fimpact.selection.regression import Regression
from fimpact.selection.rivals import among_rivals, exchanged
from fimpact.selection.substitutes import Exchange, exchanges
from fimpact.smoothing.candidates import at
from fimpact.smoothing.columns import columns, motion_scales
from fimpact.smoothing.parameters import Parameter
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

SUSPECTS = "coulomb viscous torque_offset spring gain".split()


def begun_with(friction: float, effect: str, site: str) -> tuple[Search, Regression, list]:
    """A search on a rod with so much dry friction that has answered something already, and what it would ask next."""
    made = prepare(rod(friction))
    state = Search(made.track, made.begun, made.noise, [EFFECTS[name] for name in SUSPECTS], lambda line: None)
    own = at(EFFECTS[effect], site, made.track.model, state.scales)[0]
    placed = [own.placed([0.1 * sd for sd in own.sd])]
    state.current = smooth(made.track, made.begun, made.noise, placed, [own.priors], state.naive)
    tried = state.open()
    offered = options(made.track.model, made.track.recording.channels, tried)
    return state, Regression(state.current, columns(state.current, tried)), offered


def test_the_evidence_is_the_marginal_likelihood_of_a_gaussian():
    rows = 0.05 * white(3)
    own = regression({0: 1.0}, rows)
    data = own.columns.innovations[:, 0, 0] / np.sqrt(own.dispersion)

    def exact(kept):
        wide = np.eye(COUNT) + rows[:, kept] @ rows[:, kept].T / own.dispersion
        return stats.multivariate_normal(np.zeros(COUNT), wide).logpdf(data)

    told = [own.evidence(own.solve(kept)) for kept in ([0], [1], [0, 2])]
    known = [exact(kept) for kept in ([0], [1], [0, 2])]
    np.testing.assert_allclose(np.diff(told), np.diff(known), rtol=1e-9)


def test_what_is_likelier_takes_the_place_of_what_was_answered_first():
    state, asked, offered = begun_with(0.15, "viscous", "pivot")
    assert exchanged(state, asked, offered)
    assert [law.name for law in state.current.placed] == ["coulomb@pivot"]
    assert state.current.placed[0].values["friction"] == pytest.approx(0.15, rel=0.02)


def rod_with_a_preloaded_gear(answer: list[str]) -> tuple[Search, Regression]:
    """A search on a rod whose dry friction differs between directions, that has answered `answer`."""
    runs = [waves(400, [0.5], i) for i in range(3)]
    made = prepare(record(ROD, ("angle",), runs, 1e-3, lambda model: direction_dependent(model, "pivot", 0.2, 0.1)))
    known = [EFFECTS[name] for name in ("coulomb", "torque_offset", "direction_dependent_coulomb")]
    state = Search(made.track, made.begun, made.noise, known, lambda line: None)
    own = [c for c in state.candidates if c.effect.name in answer]
    placed = [c.placed([0.1 * sd for sd in c.sd]) for c in own]
    state.current = smooth(made.track, made.begun, made.noise, placed, [c.priors for c in own], state.naive)
    tried = [*state.open(), *state.open(sums=True)]
    return state, Regression(state.current, columns(state.current, tried))


def test_a_whole_takes_the_place_of_what_it_holds_and_of_what_stands_for_the_rest_of_it(monkeypatch):
    state, asked = rod_with_a_preloaded_gear(["coulomb", "torque_offset"])
    names = {"coulomb@pivot", "torque_offset@motor"}
    assert {law.name for law in state.current.placed} == names and state.offered(asked.columns.candidates) == []
    refit, now = state.refitted, {"fit": state.current.fit, "cost": state.current.cost}
    monkeypatch.setattr(state, "refitted", lambda *own: replace(refit(*own), **now))  # as likely, but for round-off
    assert exchanged(state, asked, [])
    (law,) = state.current.placed
    assert law.name == "direction_dependent_coulomb@pivot"
    assert (law.values["forward"], law.values["backward"]) == pytest.approx((0.2, 0.1), rel=0.05)
    (before,) = state.alternatives
    assert {own.name for own in before.placed} == names and before.weight == pytest.approx(1.0)


def test_a_whole_is_no_rival_of_what_it_holds_alone(monkeypatch):
    state, asked = rod_with_a_preloaded_gear(["coulomb"])
    numbers = [c.name for c in asked.columns.candidates]
    whole = Option("direction_dependent_coulomb@pivot", 1, (numbers.index("direction_dependent_coulomb@pivot"),))
    likelier = Exchange((0,), whole, asked.solve([0]), 100.0, True, 0.0)
    monkeypatch.setattr(rivals, "exchanges", lambda *_: [likelier])
    assert not exchanged(state, asked, []) and not state.alternatives


def test_nothing_takes_the_place_of_what_is_worth_nothing():
    state, asked, offered = begun_with(0.0, "torque_offset", "motor")
    assert exchanged(state, asked, offered) and state.current.placed == ()


def test_what_is_right_stays():
    state, asked, offered = begun_with(0.15, "coulomb", "pivot")
    assert not exchanged(state, asked, offered)
    assert [law.name for law in state.current.placed] == ["coulomb@pivot"]
    assert all(alternative.placed for alternative in state.alternatives)


def test_taking_an_effect_away_leaves_the_data_of_a_model_without_it():
    _, asked, _ = begun_with(0.15, "coulomb", "pivot")
    rows, friction = asked.columns.innovations, asked.smoothed.numbers[0]
    data = rows[:, 0, 0] + rows[:, 0, 1] * (1.0 if friction.log else friction.value)
    without = asked.without([0])
    np.testing.assert_allclose(without.square, np.bincount(asked.stretch, weights=data**2), rtol=1e-9)
    np.testing.assert_allclose(without.right[:, 0], np.bincount(asked.stretch, weights=data * rows[:, 0, 1]), rtol=1e-9)
    assert without.dispersion == pytest.approx(asked.dispersion, rel=1e-4)
    assert without.square.sum() > 10 * asked.square.sum()


def test_of_each_name_the_likeliest_shape_is_told():
    _, asked, offered = begun_with(0.15, "viscous", "pivot")
    told = [e.option.name for e in exchanges(asked, offered)]
    assert len(told) == len(set(told)) and told[0] == "coulomb@pivot"


def test_without_effects_there_is_nothing_to_exchange():
    own = regression({0: 1.0}, white(2))
    assert exchanges(own, alone(2)) == []


def test_what_adds_to_what_is_in_takes_its_place_nowhere():
    """Data that hold an offset, which is in, and as much of another column."""
    made = regression({0: 0.2, 1: 0.3}, white(2))
    offset = Parameter("offset", "torque_offset@motor", "N m", 0, 0.2, 0.0, 1.0, -np.inf, np.inf, False, 1.0)
    in_it = {"numbers": (offset,), "placed": (SimpleNamespace(effect=EFFECTS["torque_offset"]),)}
    made.columns.innovations[..., 0] -= 0.2 * made.columns.innovations[..., 1]  # what is in is taken away already
    smoothed = SimpleNamespace(**{**vars(made.smoothed), **in_it})
    tried, other = made.columns.candidates[1:], alone(1)[0]
    both = Regression(smoothed, replace(made.columns, candidates=tried, owners=((0, 0),)))
    assert not [e for e in exchanges(both, [other]) if e.option is other]
    assert [e for e in exchanges(both, [other], beside=[]) if e.option is other]


def test_one_effect_takes_the_place_of_two_that_do_its_work_together():
    halves = white(2)
    made = regression({0: 0.3, 1: 0.3}, np.column_stack([halves, halves.sum(1)]))
    laws = [Parameter("damping", f"viscous@k{i}", "", i, 0.3, 0.0, 1.0, -np.inf, np.inf, False, 1.0) for i in (0, 1)]
    made.columns.innovations[..., 0] -= 0.3 * made.columns.innovations[..., 3]  # what is in is taken away already
    placed = (SimpleNamespace(effect=EFFECTS["viscous"]),) * 2
    smoothed = SimpleNamespace(**{**vars(made.smoothed), "numbers": tuple(laws), "placed": placed})
    both = Regression(smoothed, replace(made.columns, candidates=made.columns.candidates[2:], owners=((0, 0),)))
    whole = Option("viscous@j2", 1, (0,))
    assert not [e for e in exchanges(both, [whole], beside=[]) if e.option is whole and e.sure]
    found = [e for e in exchanges(both, [whole], beside=[], leaving=[(0, 1)]) if e.option is whole]
    assert [(e.places, e.sure) for e in found] == [((0, 1), True)] and found[0].weight > 1


def test_what_is_as_likely_when_refitted_joins_the_set(monkeypatch):
    state, asked, offered = begun_with(0.15, "coulomb", "pivot")
    other = next(i for i, option in enumerate(offered) if option.name == "spring@pivot")
    estimate = asked.solve([0, asked.p + asked.columns.of(offered[other].members[0])[0]])
    likelier = Exchange((0,), offered[other], estimate, 100.0, False, 0.0)
    monkeypatch.setattr(rivals, "exchanges", lambda *_: [likelier])
    monkeypatch.setattr(state, "refitted", lambda *_: state.current)
    assert not exchanged(state, asked, offered)
    assert [(a.placed, a.weight) for a in state.alternatives] == [(state.current.placed, 1.0)]


def test_a_gear_that_shows_in_its_encoder_alone_is_worth_the_force_that_it_saves():
    """An effect on a reading and, next to nothing, on the next sample: pruned once, though the likeliest of all."""
    made = prepare(rod(0.15))
    naive = smooth(made.track, made.begun, made.noise)
    own = at(EFFECTS["coulomb"], "pivot", made.track.model, motion_scales(naive))[0]
    fit = smooth(made.track, made.begun, made.noise, [own.placed([0.15])], [own.priors], naive)
    whole = Regression(fit, columns(fit, []))
    missing, column = naive.missing, len(fit.numbers) - 1
    force = share_of(whole, column, 1.0, missing)
    weak = replace(fit, linear=replace(fit.linear, offsets=1e-6 * fit.linear.offsets))
    shown = Regression(weak, whole.columns)
    assert share_of(shown, column, 1.0, missing) > 1e-2 * force


def test_a_rival_that_was_not_refitted_counts_no_more_than_the_answer(monkeypatch):
    state, asked, offered = begun_with(0.15, "coulomb", "pivot")
    monkeypatch.setattr(rivals, "RIVALS", 0)
    option = next(o for o in offered if o.name == "spring@pivot")
    estimate = asked.solve([0, asked.p + asked.columns.of(option.members[0])[0]])
    chosen = SimpleNamespace(option=SimpleNamespace(order=0, compound=False), places=("coulomb@pivot",))
    trial = SimpleNamespace(option=option, estimate=estimate, places=("spring@pivot",))
    found = SimpleNamespace(chosen=chosen, rivals=((trial, 1e4),))
    assert among_rivals(state, asked, found, state.current) is state.current
    assert [a.weight for a in state.alternatives] == [1.0]


def test_a_special_case_that_is_in_already_takes_no_other_place():
    made = prepare(rod(0.1))
    state = Search(made.track, made.begun, made.noise, [EFFECTS["coulomb"], EFFECTS["stribeck"]], lambda line: None)
    own = [next(c for c in state.candidates if c.effect.name == name) for name in ("coulomb", "stribeck")]
    placed = [c.placed([0.1 * sd for sd in c.sd]) for c in own]
    state.current = smooth(made.track, made.begun, made.noise, placed, [c.priors for c in own], state.naive)
    assert [law.name for law in simplified(state).placed] == ["coulomb@pivot", "stribeck@pivot"]
