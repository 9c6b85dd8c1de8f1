"""A more general law in the place of a special case."""

from dataclasses import replace

import numpy as np
import pytest
from planted import record

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch import name
from fimpact.mismatch.coordinates import coordinates
from fimpact.mismatch.explain import explain, without
from fimpact.mismatch.judge import base_fit, bench
from fimpact.mismatch.pulses import pulses
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import proposals, screen
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.step import Search
from fimpact.mismatch.tame import WILD
from fimpact.mismatch.widen import widened

FRICTION = 0.004  # N m
GENERAL = ["stribeck", "dahl", "direction_dependent_coulomb"]


@pytest.fixture(scope="module")
def found():
    """A search on an arm with dry friction in its second joint, and that named beside a torque offset of the first."""

    def hide(model):
        model.dof_frictionloss[1] = FRICTION

    made = bench(record(3, hide))
    free = coordinates(made.training.simulator)
    naive = explain(*base_fit(made, free, Hypothesis(made.training.simulator.theta)))
    effects = [EFFECTS[effect] for effect in ("coulomb", "torque_offset", *GENERAL)]
    tried = proposals(effects, made.training, scales(made.training, naive.fitted.point))
    parts = pulses(made.training, naive.fitted), pulses(made.held_out, naive.judged)
    search = Search(made, tuple(screen(made.training, naive.fitted, tried)), *parts, lambda line: None)
    placed = Placed(EFFECTS["coulomb"], "joint_2", {"friction": FRICTION})
    offset = Placed(EFFECTS["torque_offset"], "motor_1", {"offset": 1e-4})
    return search, without(made, naive, (placed, offset))


def test_a_general_law_fits_no_worse_than_its_special_case(found):
    search, current = found
    lines = []
    wider = list(widened(search.bench, current, search.candidates, lines.append))
    names = {f"{law}@joint_2+torque_offset@motor_1" for law in GENERAL}
    assert {rival.name for rival in wider} == names
    # A bristle that gives over no distance still does not hold a joint at rest as dry friction does.
    exact = [rival for rival in wider if not rival.name.startswith("dahl")]
    assert all(rival.fitted.point.cost < current.fitted.point.cost + 1 for rival in exact)
    assert "refitting with stribeck@joint_2 in the place of coulomb@joint_2" in lines


def test_what_is_named_already_is_no_general_law_for_another(found):
    search, current = found
    dahl = Placed(EFFECTS["dahl"], "joint_2", {"friction": 0.1 * FRICTION, "displacement": 0.1})
    both = replace(current, placed=(current.placed[0], dahl))
    begun = []
    next(widened(search.bench, both, search.candidates, begun.append))
    assert not any(line.startswith("refitting with dahl") for line in begun)


def test_general_laws_are_asked_for_where_nothing_is_near_the_noise(found, monkeypatch):
    search, current = found
    calls = []
    monkeypatch.setattr(name, "widened", lambda *given: calls.append(given[1].name) or [])
    monkeypatch.setattr(name, "_left_out", lambda search, rivals: rivals)
    for dispersion in (0.9 * WILD, 1.1 * WILD):
        name._reconsider(search, [replace(current, dispersion=dispersion)])
    assert calls == [current.name]


def test_of_one_name_the_better_fit_is_compared(found):
    _, current = found
    worse = replace(current, fitted=replace(current.fitted, point=replace(current.fitted.point, cost=1e9)))
    diverged = replace(current, deviance=np.inf)
    for rivals in ([worse, current], [current, worse], [diverged, worse, current]):
        (kept,) = name._best_of_each(rivals)
        assert kept.fitted.point.cost == current.fitted.point.cost and np.isfinite(kept.deviance)


@pytest.mark.parametrize(("dispersion", "rounds"), [(0.9 * WILD, 1), (1.1 * WILD, 2)])
def test_far_from_the_noise_all_is_asked_again_while_the_lead_changes(found, monkeypatch, dispersion, rounds):
    search, current = found
    lead, other = replace(current, dispersion=dispersion), replace(current, placed=current.placed[::-1] * 2)
    asked = []

    def left_out(search, rivals):
        asked.append(rivals[0].name)
        return [replace(other, dispersion=dispersion)]

    monkeypatch.setattr(name, "widened", lambda *_: [])
    monkeypatch.setattr(Search, "compared", lambda self, rivals: rivals)
    monkeypatch.setattr(name, "_left_out", left_out)
    assert name._reconsider(search, [lead])[0].name == other.name
    assert asked == [lead.name, other.name][:rounds]
