"""A rival must keep its word on held-out windows before it is believed."""

from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.concealed.strangers import known
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch.accept import _own, accepted, hopeful, idle, improved, kept, worthwhile
from fimpact.mismatch.generalised import tempered
from fimpact.mismatch.name import SUSPECT, _further, answered
from fimpact.mismatch.nameless import Stranger
from fimpact.mismatch.naming import CROWD, CROWDED, DOUBTED, RIGHT, SHARP, Naming
from fimpact.mismatch.problem import Point
from fimpact.mismatch.step import HOPELESS, SEEN, Step, _worst, step
from fimpact.mismatch.tame import WILD

SAMPLES = 100


def rival(name, *squares, friction=0.1, dispersion=3.0):
    """An explanation whose held-out windows have these sums of squares."""
    residual = np.sqrt(np.array(squares) / SAMPLES)[:, None] * np.ones(SAMPLES)
    point = Point(None, None, None, residual, np.sum(squares) / 2)
    judged = SimpleNamespace(point=point)
    placed = (Placed(EFFECTS["coulomb"], "joint_1", {"friction": friction}),)
    known = {"weight": 1.0, "loudness": dispersion, "offsets": None}
    return SimpleNamespace(name=name, fitted=0, judged=judged, placed=placed, **known)


def naive_bench():
    bench = SimpleNamespace(offsets="naive")
    bench.restore = lambda state: setattr(bench, "offsets", state)
    return bench


def test_numerics_that_are_known_are_sought_again_only_far_from_the_noise(monkeypatch):
    monkeypatch.setattr("fimpact.mismatch.accept.numerics", lambda *_: "sought")

    def promised(offsets="own", loudness=WILD, size=1.0):
        point = Point(None, None, None, np.full((1, SAMPLES), size), SAMPLES * size**2 / 2)
        return SimpleNamespace(offsets=offsets, loudness=loudness, fitted=SimpleNamespace(point=point))

    bench = naive_bench()
    for far in (promised(None), promised(loudness=1.01 * WILD), promised(size=4.0)):
        assert _own(bench, far) == "sought" and bench.offsets == "naive"
    near = promised()
    assert _own(bench, near) is near and bench.offsets == "own"


def test_what_rules_another_out_is_near_the_noise_and_could_be_simulated():
    def tried(*sizes, deviance=0.0):
        residual = np.outer(sizes, np.ones(SAMPLES))
        point = Point(None, None, None, residual, (residual**2).sum() / 2)
        return SimpleNamespace(deviance=deviance, fitted=SimpleNamespace(point=point))

    quiet, unknown = tried(1.0, 1.0), tried(0.5, 0.5, deviance=np.inf)
    assert _worst([]) == _worst([tried(3.0, 3.0)]) == _worst([unknown]) == np.inf
    assert _worst([quiet, tried(2.0, 2.0), unknown]) == pytest.approx(SAMPLES + HOPELESS)
    # Where disturbances make it so loud, or windows so unlike, training alone tells less.
    assert _worst([tried(2.0, 2.0)]) == pytest.approx(4 * (SAMPLES + HOPELESS))
    assert _worst([tried(*7 * [1.0], 3.0)]) == np.inf


def test_squares_beyond_noise_count_by_their_logarithm():
    np.testing.assert_allclose(tempered(np.array([50.0, 100.0, 100 * np.e]), np.array(100)), [50, 100, 200])


def test_a_rival_keeps_its_word_in_loud_windows_and_in_quiet_ones():
    naive = rival("none", 300, 300, 300, 9000)
    assert kept(naive, rival("better", 200, 200, 200, 8900))
    assert not kept(naive, rival("worse where it is loud", 200, 200, 200, 12000))
    assert not kept(naive, rival("worse where it is quiet", 500, 500, 500, 8000))


def test_held_out_windows_are_predicted_better_if_neither_loud_ones_nor_chance_make_it_so():
    naive = rival("none", 300, 300, 300, 9000)
    assert improved(naive, rival("better", 290, 290, 290, 8990))
    assert not improved(naive, rival("by chance", 299, 299, 300, 9000))
    assert not improved(naive, rival("where it is loud", 500, 500, 500, 7000))


@pytest.mark.parametrize(("p", "really", "found"), [(0.0002, True, True), (0.0002, False, False), (0.01, True, False)])
def test_what_training_shows_beyond_doubt_and_held_out_runs_really_show_is_worth_having(monkeypatch, p, really, found):
    """Whatever one linear step makes of it."""
    told = np.array([[500.0, 200.0, 220.0], [0.0, 0.0, 0.0]])
    for name, value in (("predicted", told), ("disturbance", None), ("colour", None), ("improved", really)):
        monkeypatch.setattr(f"fimpact.mismatch.accept.{name}", lambda *_, value=value: value)
    last = SimpleNamespace(rivals=[SimpleNamespace(fitted=0)], least=p)
    search = SimpleNamespace(pulses=None, held_out=None, bench=None)
    assert worthwhile(search, None, SimpleNamespace(placed=[1]), last) is found


def test_once_the_likeliest_has_failed_only_those_that_predict_no_worse_are_tried():
    best, rivals = rival("none", 300), [rival("likeliest", 900), rival("worse", 900), rival("better", 200)]
    assert [r.name for r in hopeful(best, rivals)] == ["likeliest", "better"]


def test_where_nothing_is_near_the_noise_only_those_that_predict_better_are_tried():
    best, held_out = rival("none", 9e4), {"likeliest": 9e4, "idle": 9e4, "better": 2e4}
    rivals = [rival(name, squares, dispersion=2 * WILD) for name, squares in held_out.items()]
    assert [r.name for r in hopeful(best, rivals)] == ["likeliest", "better"]


@pytest.mark.parametrize(
    ("plain", "sharp", "friction", "far", "found"),
    [
        (200, 150, 0.1, 1.0, "sharp"),
        (200, 900, 0.1, 1.0, "plain"),
        (900, 900, 0.1, 1.0, None),
        (200, 150, 0.0, 1.0, None),  # it does nothing
        (150, 200, 0.1, 1.0, "sharp"),
        (150, 200, 0.1, 2.0, "plain"),  # nothing is near the noise
        (200, 150, 0.1, 2.0, "sharp"),
        (150, 200, 0.0, 2.0, None),
    ],
)
def test_the_generalised_optimum_is_taken_only_where_it_keeps_its_word(monkeypatch, plain, sharp, friction, far, found):
    bench = naive_bench()

    def arriving(name, squares):
        def at(*_):
            bench.offsets = name
            return rival(name, squares, friction=friction, dispersion=far * (WILD - 1))

        return at

    monkeypatch.setattr("fimpact.mismatch.accept.numerics", arriving("plain", plain))
    monkeypatch.setattr("fimpact.mismatch.accept.sharpened", arriving("sharp", sharp))
    monkeypatch.setattr("fimpact.mismatch.accept.tamed", lambda _, found: found)
    answer = accepted(SimpleNamespace(bench=bench, pulses=None), rival("none", 300), rival("promised", 0))
    assert (answer.name if answer else None, bench.offsets) == (found, found or "naive")


@pytest.mark.parametrize(("among", "dispersion", "found"), [(250, 1.5, True), (350, 1.5, False), (250, 3.0, False)])
def test_disturbances_that_are_what_they_are_taken_for_decide(monkeypatch, among, dispersion, found):
    """332 of the blind benchmark: the plain fit had bent its parameters to follow disturbances."""
    told = np.array([[300.0, among], [0.0, 0.0]])
    for name, value in (("disturbance", None), ("colour", None), ("predicted", told)):
        monkeypatch.setattr(f"fimpact.mismatch.accept.{name}", lambda *_, value=value: value)
    sharp = rival("sharp", 900, dispersion=dispersion)
    monkeypatch.setattr("fimpact.mismatch.accept.numerics", lambda *_: rival("plain", 900))
    monkeypatch.setattr("fimpact.mismatch.accept.sharpened", lambda *_: sharp)
    search = SimpleNamespace(bench=SimpleNamespace(offsets=0, restore=lambda _: 0), pulses=None, held_out=None)
    assert (accepted(search, rival("none", 300), rival("promised", 0)) is sharp) is found


@pytest.mark.parametrize(
    ("placed", "gain", "relief", "p", "found"),
    [
        (1, 20.0, 0.0, 0.01, True),
        (1, 5.0, 0.0, 0.01, False),
        (1, 5.0, 0.0, 0.0002, True),
        (1, -1.0, 0.0, 0.0002, False),
        (1, 0.0, 60.0, 0.01, True),
        (1, 20.0, -15.0, 0.01, False),
        (0, 1.0, 0.0, 1.0, True),
        (0, -3.0, 0.0, 1.0, False),
        (0, -0.5, 0.0, 0.01, False),
        (0, -0.5, 0.0, 0.004, True),
        (0, -8.0, 0.0, 0.004, False),
        (0, -8.0, 0.0, 0.0002, True),
        (0, -10.0, 0.0, 0.0002, False),
    ],
)
def test_a_further_effect_explains_more_than_a_trace_or_is_beyond_doubt_or_relieves_what_was_known(
    monkeypatch, placed, gain, relief, p, found
):
    told = np.array([[500.0, 200.0, 200.0 - gain], [0.0, 100.0, 100.0 - relief]])
    monkeypatch.setattr("fimpact.mismatch.accept.predicted", lambda *_: told)
    monkeypatch.setattr("fimpact.mismatch.accept.disturbance", lambda *_: None)
    monkeypatch.setattr("fimpact.mismatch.accept.colour", lambda *_: None)
    monkeypatch.setattr("fimpact.mismatch.accept.improved", lambda *_: False)
    current, last = SimpleNamespace(placed=[1] * placed), SimpleNamespace(rivals=[SimpleNamespace(fitted=0)], least=p)
    search = SimpleNamespace(pulses=None, held_out=None, bench=None)
    assert worthwhile(search, None, current, last) is found


@pytest.mark.parametrize(("p", "beside"), [(0.005, True), (0.5, False)])
def test_what_was_called_for_and_refused_may_be_missing(p, beside):
    best = SimpleNamespace(placed=(1,))
    naming = Naming(
        None, [SimpleNamespace(least=p, rivals=[])], best, [], 0.0, Stranger(0.9, 0.0, ""), 1.0, 1.0, None, None
    )
    assert naming.beside is beside


def test_effects_are_told_in_the_order_in_which_they_led():
    """What is left out and asked for anew is fitted last, and is not the least of them."""
    dry, viscous, one_way = (SimpleNamespace(name=name) for name in ("dry", "viscous", "one way"))
    rounds = [[dry], [dry, SimpleNamespace(name="drag")], [one_way, dry, viscous]]
    steps = [SimpleNamespace(least=0.0, rivals=[SimpleNamespace(placed=led)]) for led in rounds]
    steps.append(SimpleNamespace(least=1.0, rivals=[]))
    best = SimpleNamespace(placed=(viscous, one_way, dry))
    naming = Naming(None, steps, best, [], 0.0, Stranger(1.0, 0.0, ""), 1.0, 1.0, None, None)
    assert naming.found == [dry, viscous, one_way]


def test_an_effect_at_its_bound_does_nothing():
    def explained(*placed):
        return SimpleNamespace(placed=placed)

    spring = Placed(EFFECTS["spring"], "joint_1", {"stiffness": 0.3, "rest": 0.0})
    dry = Placed(EFFECTS["coulomb"], "joint_1", {"friction": 0.0})
    one_way = Placed(EFFECTS["direction_dependent_coulomb"], "joint_1", {"forward": 0.0, "backward": 0.1})
    assert idle(explained(spring, dry))
    assert not idle(explained(spring, one_way))


@pytest.mark.parametrize(("change", "found"), [(-0.99, True), (-0.5, False), (0.0, False)])
def test_an_effect_as_large_as_it_may_be_stands_in_for_something_else(change, found):
    soft = Placed(EFFECTS["contact_stiffness"], "table", {"change": change})
    one_way = Placed(EFFECTS["direction_dependent_coulomb"], "joint_1", {"forward": 1e-9, "backward": 0.1})
    assert soft.at_limit is found and not one_way.at_limit


def test_what_is_as_large_as_it_may_be_is_asked_after_all_others(monkeypatch):
    stand_in, likely, other = (SimpleNamespace(placed=[SimpleNamespace(at_limit=at)]) for at in (True, False, False))
    asked, search = [], SimpleNamespace(ranked=list)
    monkeypatch.setattr("fimpact.mismatch.name._serving", lambda *a: asked.append(a[3].rivals))
    assert _further(search, None, None, Step([], np.zeros(0), [stand_in, likely, other]), set()) is None
    assert asked == [[likely, other], [stand_in]]


def naming(*weights, nameless=1.0, left=0.0, effects=1, windows=20, p=1.0, rivals=()):
    members = [SimpleNamespace(name=f"name {i}", weight=w) for i, w in enumerate(weights)]
    best = SimpleNamespace(placed=(1,) * effects, name="name 0" if effects else "none")
    placed = (Placed(EFFECTS["coulomb"], "joint_1", {"friction": 0.1}),)
    steps = [
        SimpleNamespace(least=p, rivals=[SimpleNamespace(name=f"rival {w}", placed=placed, weight=w) for w in rivals])
    ]
    pulses = SimpleNamespace(time=range(windows))
    return Naming(None, steps, best, members, left, Stranger(nameless, 0.0, ""), 1.0, 1.0, np.zeros((0, 0)), pulses)


def test_stated_confidence_is_what_such_weights_have_been_worth():
    assert naming(1.0).confidence == {"name 0": pytest.approx(sum(RIGHT))}
    several = naming(0.5, 0.3, 0.2).confidence
    assert several["name 0"] == pytest.approx(RIGHT[0] + RIGHT[1] * 0.5**SHARP)
    assert several["name 1"] / several["name 2"] == pytest.approx(1.5)
    assert sum(several.values()) <= 1.0 + 1e-12
    assert naming(1.0, nameless=0.04).confidence == {"name 0": pytest.approx(DOUBTED * sum(RIGHT))}
    crowd = naming(0.3, 0.2, 0.2, 0.1, 0.1, 0.1).confidence
    assert len(crowd) == CROWD and crowd["name 0"] == pytest.approx(CROWDED * (RIGHT[0] + RIGHT[1] * 0.3**SHARP))
    assert naming(1.0, left=0.3).confidence == {"name 0": pytest.approx(DOUBTED * sum(RIGHT))}


@pytest.mark.parametrize(
    ("left", "p", "said"), [(0.3, 1.0, True), (0.2, 1.0, False), (0.12, 0.4, True), (0.08, 0.4, False)]
)
def test_an_answer_that_leaves_a_quarter_or_a_tenth_that_is_hardly_chance_says_so(left, p, said):
    assert naming(1.0, left=left, nameless=p).answer_set == ["name 0"] + ["unnamed"] * said


def test_a_name_that_alone_could_be_chance_says_so():
    assert naming(1.0, p=0.03, rivals=(1.0,)).answer_set == ["name 0", "unnamed"]
    assert naming(1.0, p=0.001, rivals=(1.0,), effects=3).suspected is False


def test_names_that_are_called_for_and_refused_stay_possible():
    refused = naming(effects=0, p=0.001, rivals=(0.8, 0.2, 0.003))
    assert refused.answer_set == ["unnamed", "rival 0.8", "rival 0.2"]
    assert naming(1.0, p=0.001, rivals=(0.8, 0.2)).refused == []


@pytest.mark.parametrize(
    ("p", "certain", "alarms"), [(0.03, True, 2), (0.03, False, 1), (0.2, True, 1), (0.001, True, 1)]
)
def test_which_name_is_asked_where_something_is_missing_for_certain(monkeypatch, p, certain, alarms):
    asked, told = [], SimpleNamespace(certain=certain, p=p)
    monkeypatch.setattr("fimpact.mismatch.name.build", lambda *given: asked.append(given[2:]) or ([], None, []))
    monkeypatch.setattr("fimpact.mismatch.name._answer", lambda *_: told)
    assert answered(None, None) is told
    assert asked == [(), (SUSPECT,)][:alarms]


def test_a_few_windows_are_not_certain_of_what_has_no_name():
    assert naming(1.0, nameless=0.001, left=0.5).answer == "unnamed"
    assert naming(1.0, nameless=0.001, left=0.5, windows=7).answer == "name 0"
    assert naming(1.0, nameless=0.001, left=0.5, windows=7).answer_set == ["name 0", "unnamed"]


def test_what_calls_for_a_name_and_has_none_that_keeps_its_word_is_not_nothing():
    assert naming(effects=0, p=0.001).answer_set == ["unnamed"]
    assert naming(effects=0, p=0.006).answer_set == ["none"]
    assert naming(effects=0, p=0.001, windows=7).answer_set == ["none"]


def test_an_answer_of_as_many_effects_as_are_tried_says_that_more_may_be_missing():
    assert naming(1.0, effects=2).answer_set == ["name 0"]
    assert naming(1.0, effects=3).answer_set == ["name 0", "unnamed"]


def test_effects_that_stand_in_for_what_has_no_name_are_not_worth_an_experiment():
    several = {"nameless": 0.001, "left": 0.5}
    assert naming(0.6, 0.4, effects=3, **several).contenders == []
    assert len(naming(0.6, 0.4, effects=1, **several).contenders) == 2
    assert len(naming(0.6, 0.4, effects=3).contenders) == 2


def test_what_acts_in_contact_only_is_known_as_such():
    for name, effect in EFFECTS.items():
        assert effect.touching == (known(name).mode == "contact"), name


def test_a_judge_that_has_seen_the_strongest_candidate_counts_for_less(monkeypatch):
    told = iter([np.array([0.5, 0.001]), np.array([0.004, 0.2])])  # beside nothing, and beside what is left
    for name in ("coloured", "_by_gain", "_beside"):
        monkeypatch.setattr(f"fimpact.mismatch.step.{name}", lambda *_: [SimpleNamespace(gain=0.0, allowed=True)] * 2)
    monkeypatch.setattr("fimpact.mismatch.step.family_p", lambda *_: next(told))
    search = SimpleNamespace(bench=None, candidates=(), pulses=None)
    found = step(search, SimpleNamespace(placed=(), fitted=None), least=1.0)
    np.testing.assert_allclose(found.p, [SEEN * 0.004, 0.001])
