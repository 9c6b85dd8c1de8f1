"""What one more run says of rivals, and which run would say most."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from planted import record

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch import separate
from fimpact.mismatch.bounded import bounded
from fimpact.mismatch.coordinates import coordinates
from fimpact.mismatch.discriminate import ENOUGH, GENERATIONS, PATIENCE, TRIED, Limits, _search, limits, worth
from fimpact.mismatch.explain import explain, sizes_of
from fimpact.mismatch.fit import fit
from fimpact.mismatch.judge import base_fit, bench
from fimpact.mismatch.problem import Linear, Problem
from fimpact.mismatch.resolve import _anew, _fitted, _may_turn, _priced, remaining, resolve
from fimpact.mismatch.separate import MOST, _left, _moved, known, separations
from fimpact.mismatch.settle import first_point, settled
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.weigh import members as told_apart
from fimpact.mismatch.windows import cut

FRICTION = 0.004  # N m
COULOMB = {"coulomb@joint_2": {"friction": FRICTION}}
OFFSET = {"torque_offset@motor_2": {"offset": 0.001}}
DAHL = {"dahl@joint_2": {"friction": FRICTION, "displacement": 0.1}}


def hide_friction(model):
    model.dof_frictionloss[1] = FRICTION


@pytest.fixture(scope="module")
def recording():
    return record(3, hide_friction)


@pytest.fixture(scope="module")
def rivals(recording):
    made = bench(recording)
    theta = Hypothesis(made.training.simulator.theta)
    fitted, judged = base_fit(made, coordinates(made.training.simulator), theta)
    return made, [_explained(made, fitted.point, judged, member) for member in (COULOMB, OFFSET)]


def _explained(made, point, judged, member):
    ((name, values),) = member.items()
    placed = (Placed(EFFECTS[name.split("@")[0]], name.split("@")[1], values),)
    free = coordinates(made.training.simulator, placed, tuple(map(sizes_of, placed)))
    start = made.training.evaluate(Hypothesis(point.hypothesis.theta, placed), point.qpos, point.qvel, free)
    return explain(fit(made.training, free, start), judged)


def test_a_window_that_no_rival_follows_spoils_nothing(recording):
    """A wild stretch, as of a motion that amplifies whatever is not known, must not hide what the others say."""
    run = recording.held_out[0]
    measured = run.measured.copy()
    measured[80:160] += 0.3 * np.sin(np.arange(80) * 0.2)[:, None]
    found = resolve(recording, [replace(run, measured=measured)], [OFFSET, COULOMB])
    assert found[0].name == "coulomb@joint_2" and found[0].weight > 0.99
    assert found[0].dispersion < 1.5 and not found[0].exact  # nothing is left to be decided by the time step's error


def test_that_an_experiment_strays_is_no_reason_for_long_steps(recording, monkeypatch):
    """They take minutes, and where only the experiment's windows are far from the noise those are left out."""
    tried = []
    monkeypatch.setattr("fimpact.mismatch.fit.can_touch", lambda model: True)
    monkeypatch.setattr("fimpact.mismatch.fit.leaped", lambda p, c, point, along: tried.append(along) or point)
    run = recording.held_out[0]
    measured = run.measured.copy()
    measured[80:160] += 0.3 * np.sin(np.arange(80) * 0.2)[:, None]
    assert resolve(recording, [replace(run, measured=measured)], [OFFSET, COULOMB])[0].name == "coulomb@joint_2"
    assert tried and set(tried) == {()}


def test_a_rival_that_became_its_own_special_case_is_no_rival(recording):
    """Dahl's friction without a displacement is dry friction: what was stated is refuted."""
    found = resolve(recording, recording.held_out[:1], [DAHL, COULOMB])
    assert [e.name for e in told_apart(found[0], found[1:])] == ["coulomb@joint_2"]
    assert sum(e.weight for e in found) == pytest.approx(1.0) and len(found) == 2


def test_a_shape_that_no_recording_showed_is_sought_where_a_screening_seeks_it(rivals, monkeypatch):
    """A displacement far from what was stated is out of reach of the tangent there."""
    made, members = rivals
    looked = []

    def fitted(made, near, member, held, look=False):
        (values,) = member.values()
        looked.append(values["displacement"])
        placed = (Placed(EFFECTS["dahl"], "joint_2", values, {"friction": 1.0, "displacement": 1.0}),)
        hypothesis = replace(members[0].fitted.point.hypothesis, placed=placed)
        point = replace(members[0].fitted.point, hypothesis=hypothesis, cost=abs(values["displacement"] - 0.1))
        return replace(members[0].fitted, point=point)

    def explained(*given, **how):
        found = fitted(*given, **how)
        return replace(members[0], placed=found.point.hypothesis.placed, fitted=found)

    monkeypatch.setattr("fimpact.mismatch.resolve._fit", fitted)
    monkeypatch.setattr("fimpact.mismatch.resolve._refitted", explained)
    stated = explained(made, members[0], {"dahl@joint_2": {"friction": FRICTION, "displacement": 1e-6}}, False)
    found = _anew(made, stated).placed[0].values["displacement"]
    _, *tried, again = looked
    assert tried[0] == 1e-6 and len(tried) == 4 and found == again == min(tried, key=lambda d: abs(d - 0.1))
    assert _anew(made, members[0]) is members[0]  # there is no shape to seek


SLIP = {"stribeck@joint_2": {"coulomb": FRICTION, "excess": 0.0, "speed": 0.1}}


@pytest.mark.parametrize(("member", "turns"), [(DAHL, True), (SLIP, False), (COULOMB, False)])
def test_a_shape_stays_as_stated_unless_moving_it_would_pay(recording, member, turns):
    """To fit every shape again took half of the time, and most have nothing to gain."""
    made = bench(recording)
    (found,) = _fitted(made, made.training.simulator.theta, [member], ())
    shapes = [c.name for p in found.placed for c in p.effect.coefficients if c.shape]
    assert all(found.placed[0].values[name] == member[found.name][name] for name in shapes)
    assert _may_turn(made, found) is turns


@pytest.mark.parametrize("place", [0, 1])
def test_a_member_that_diverges_on_the_added_runs_is_named(recording, place):
    members = [OFFSET, OFFSET]
    members[place] = {"quadratic_drag@link_2": {"coefficient": -1e9}}
    with pytest.raises(ValueError, match=r"quadratic_drag@link_2 at .* cannot be simulated on the added runs"):
        resolve(recording, recording.held_out[:1], members)


def test_what_is_known_of_a_point_nearby_takes_the_first_step(recording, monkeypatch):
    made = bench(recording)
    problem, free = made.training, coordinates(made.training.simulator)
    point = first_point(problem, free, Hypothesis(problem.simulator.theta))
    known, asked = problem.linearise(point, free), []
    ask = Problem.starts_at
    monkeypatch.setattr(Problem, "starts_at", lambda *args: asked.append(args) or ask(*args))
    assert settled(problem, free, point, 1, known).cost < point.cost / 2
    assert not asked


def test_after_an_experiment_a_name_remains_that_is_a_twentieth_as_likely(rivals):
    best, other = rivals[1]
    names = [remaining([replace(best, weight=0.9), replace(other, weight=w)]) for w in (0.046, 0.044)]
    assert names == [["coulomb@joint_2", "torque_offset@motor_2"], ["coulomb@joint_2"]]


def test_members_of_several_effects_are_resolved_too(recording, monkeypatch):
    monkeypatch.setattr("fimpact.mismatch.resolve.CLOSE", 0.0)
    found = resolve(recording, recording.held_out[:1], [COULOMB | OFFSET, OFFSET])
    assert found[0].name == "coulomb@joint_2+torque_offset@motor_2" and found[0].weight > 0.99
    assert found[0].exact and found[1].exact  # both come near, so the time step's error is each one's own


def test_windows_without_a_measurement_are_left_out(recording):
    run = recording.training[0]
    measured = run.measured.copy()
    measured[80:160] = np.nan
    assert cut([replace(run, measured=measured)], 80).first.tolist() == [0, 160]
    assert len(cut([replace(run, measured=np.full_like(measured, np.nan))], 80).first) == 3


def test_what_is_held_is_no_coordinate(rivals):
    free = rivals[1][0].fitted.coordinates
    less = free.without([(0, "friction")])
    assert less.values == () and less.unknowns == free.unknowns and len(less.scale) == len(free.scale) - 1
    assert free.without([]).values == free.values


def test_a_disturbance_hides_what_separates(rivals):
    made, members = rivals
    allowed, told = limits(made, made.training.simulator.recording), known(made, members)
    designs = [allowed.unpack(design) for design in allowed.draw(np.random.default_rng(0), 3)]
    parts = [np.array(part) for part in zip(*designs, strict=True)]
    quiet = separations(made, told, *parts)
    louder = replace(told, pushing=replace(told.pushing, sd=told.pushing.sd + 0.01))
    assert quiet.shape == (3, 1) and (quiet > 0).all()
    assert (separations(made, louder, *parts) < 0.5 * quiet).all()


def test_no_window_alone_separates():
    """Motion that amplifies a difference amplifies what hides it: what one window shows counts up to a limit, and what
    the coordinates may absorb is not asked of that window."""
    slope = np.ones((2, 4, 1))
    linear = Linear(np.zeros((2, 4, 0)), np.zeros((2, 0, 0)), slope, slope)
    shown = np.array([[1.0, -1.0, 0.5, -0.5], [200.0, -200.0, 300.0, -300.0]])
    found = _left(shown, linear, 1e-6 * np.eye(1), 1)
    assert found == pytest.approx([2.5 + MOST], rel=1e-3)
    assert _left(shown + 1.0, linear, 1e-6 * np.eye(1), 1) == pytest.approx(found, rel=1e-2)
    assert _left(shown, linear, 1e-6 * np.eye(1), 2) == pytest.approx([2.5, MOST], rel=1e-3)


def moved_by(motors: int) -> mujoco.MjModel:
    """A sled with so many motors."""
    motor = '<motor joint="rail"/>' * motors
    return mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="rail" type="slide"/><geom size="0.1"/></body></worldbody>'
        f"<actuator>{motor}</actuator></mujoco>"
    )


@pytest.mark.parametrize(("value", "searched"), [(2 * ENOUGH, 0), (ENOUGH / 2, PATIENCE + 1)])
def test_a_search_ends_when_more_is_not_needed_or_not_found(value, searched):
    calls, allowed = [], Limits(np.zeros(3), np.ones(3), 5, moved_by(0))

    def constant(designs):
        calls.append(len(designs))
        return np.full((len(designs), 1), value)

    found, pairs = _search(constant, allowed, np.full(3, 0.5), np.array([value]), 0)
    assert len(calls) == searched and pairs == [value] and found == pytest.approx([0.5] * 3)


def test_a_search_that_finds_nothing_worth_playing_ends_early():
    values = iter(np.logspace(-6, -3, GENERATIONS))
    allowed = Limits(np.zeros(3), np.ones(3), 5, moved_by(0))
    _, pairs = _search(
        lambda designs: np.full((len(designs), 1), next(values)), allowed, np.zeros(3), np.array([1e-9]), 0
    )
    assert pairs == [np.logspace(-6, -3, GENERATIONS)[TRIED - 1]]


def test_a_pair_that_nothing_separates_does_not_decide():
    pairs = np.array([[0.1, 5.0], [0.1, 50.0], [0.2, 5.0]])
    assert np.argmax(worth(pairs)) == 1


def test_a_special_case_is_told_by_what_only_the_general_one_does(rivals, monkeypatch):
    """Dry friction that rises near rest can always do without that; it is asked whether dry friction alone could do
    with it."""
    made, (coulomb, _) = rivals
    stribeck = {"stribeck@joint_2": {"coulomb": FRICTION, "excess": FRICTION, "speed": 0.3}}
    general = _explained(made, coulomb.fitted.point, coulomb.judged, stribeck)
    placed = (replace(general.placed[0], values=stribeck["stribeck@joint_2"]),)
    at = Hypothesis(general.fitted.point.hypothesis.theta, placed)
    far = replace(general.fitted, point=replace(general.fitted.point, hypothesis=at))
    allowed = limits(made, made.training.simulator.recording)
    parts = [part[None] for part in allowed.unpack(allowed.draw(np.random.default_rng(0), 1)[0])]
    told = known(made, [coulomb, replace(general, fitted=far)])
    told = replace(told, information=[told.information[0], 0.0 * told.information[1]])
    found = separations(made, told, *parts)
    monkeypatch.setattr(separate, "_contains", lambda *_: False)
    assert (separations(made, told, *parts) < 0.1 * found).all()


def test_commands_go_gently_or_at_once_from_knot_to_knot():
    knots = np.tile([[0.0], [1.0]], (4, 1)).ravel()
    allowed = Limits(np.zeros(13), np.ones(13), 71, moved_by(1))
    gently, at_once = (allowed.unpack(np.append(knots, [part, 0, 0, 0, 0]))[0][:, 0] for part in (1.0, 0.02))
    assert np.diff(gently) == pytest.approx(np.tile(np.repeat([0.1, -0.1], 10), 4)[:70])
    assert set(np.unique(at_once)) == {0.0, 0.5, 1.0}


def test_a_thrown_body_has_no_commands():
    allowed = Limits(np.array([1.0, 0.0, 2.0, 3.0]), np.array([1.0, 1.0, 2.0, 3.0]), 5, moved_by(0))
    ctrl, qpos, qvel = allowed.unpack(allowed.low)
    assert ctrl.shape == (5, 0) and qpos.tolist() == [2.0] and qvel.tolist() == [3.0]


def test_a_free_body_is_thrown_from_an_orientation():
    xml = "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    ends = np.r_[0.1, 0, np.zeros(3), -np.ones(4), np.zeros(6)], np.r_[1.0, 1, np.ones(3), np.ones(4), np.ones(6)]
    allowed = Limits(*ends, 5, mujoco.MjModel.from_xml_string(xml))
    for design in allowed.draw(np.random.default_rng(0), 5):
        _, qpos, qvel = allowed.unpack(design)
        assert np.linalg.norm(qpos[3:]) == pytest.approx(1.0)
        assert qpos[:3].tolist() == design[2:5].tolist() and qvel.tolist() == design[9:].tolist()


def test_a_step_that_meets_a_bound_is_asked_again():
    """Stiffness and rest of a spring that is nearly a constant force: what one gives up the other must not count on."""
    columns = np.array([[1.0, 1.0], [0.0, 0.1]])
    hessian, slope = columns.T @ columns, columns.T @ np.array([-1.0, 0.5])
    step = bounded(hessian, slope, np.ones(2), np.array([-0.5, -np.inf]), np.full(2, np.inf))
    alone = (slope[1] - hessian[1, 0] * -0.5) / hessian[1, 1]
    assert step == pytest.approx([-0.5, alone])
    assert bounded(hessian, slope, np.ones(2), np.full(2, -np.inf), np.full(2, np.inf)) == pytest.approx([-6.0, 5.0])


def test_a_step_that_meets_several_bounds_is_not_worse_than_none():
    """In a valley, a mass and its place, cut off at both bounds at once no longer match."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        columns = rng.standard_normal((5, 3)) @ np.diag([1.0, 1.0, 0.01]) @ rng.standard_normal((3, 3))
        hessian, slope = columns.T @ columns, columns.T @ rng.standard_normal(5)
        low, high = -rng.uniform(0, 0.3, 3), rng.uniform(0, 0.3, 3)
        step = bounded(hessian, slope, np.ones(3), low, high)
        assert (low <= step).all() and (step <= high).all()
        assert slope @ step - step @ hessian @ step / 2 >= -1e-9


def test_unknowns_that_the_recordings_leave_open_separate_nothing(rivals):
    """The same effect fitted with other lengths and masses is the same explanation."""
    made, members = rivals
    fitted, (own, _) = members[0].fitted, known(made, members).information
    off = 0.01 * fitted.point.hypothesis.theta
    along = -own[len(off), : len(off)] @ off / own[len(off), len(off)]
    other = replace(members[0], fitted=_moved(fitted, fitted.point.hypothesis.theta + off, np.array([along])))
    allowed, told = limits(made, made.training.simulator.recording), known(made, [members[0], other])
    parts = [part[None] for part in allowed.unpack(allowed.draw(np.random.default_rng(0), 1)[0])]
    apart = separations(made, known(made, members), *parts)
    assert (separations(made, told, *parts) < 1e-6 * apart).all()


def test_square_waves_stay_within_the_limits_and_random_experiments_have_none():
    bounds = np.append(np.full(8, -1.0), [0.02, 0, 0, 0, 0]), np.append(np.full(8, 2.0), [1.0, 1, 1, 0, 0])
    allowed, rng = Limits(*bounds, 64, moved_by(1)), np.random.default_rng(0)
    flat = np.append(np.full(8, 0.5), [1.0, 0.5])
    slow, quick = (allowed.unpack(np.append(flat, [pace, 0, 0]))[0][:, 0] for pace in (0.0, 1.0))
    assert slow == pytest.approx(np.repeat([1.25, -0.25], 32)) and np.abs(np.diff(quick)).sum() == 31 * 1.5
    waved = np.array([allowed.unpack(design)[0] for design in allowed.draw(rng, 20, waves=True)])
    assert waved.min() >= -1.0 and waved.max() <= 2.0
    assert not allowed.draw(rng, 20)[:, 9].any()


@pytest.mark.parametrize(("cost", "leads"), [(0.4, "coulomb@joint_2"), (0.5, "torque_offset@motor_2")])
def test_after_an_experiment_the_first_of_the_catalogue_leads_equals(rivals, monkeypatch, cost, leads):
    """As it does before."""
    best, other = rivals[1]
    costs = {best.name: cost, other.name: 0.0}
    monkeypatch.setattr("fimpact.mismatch.resolve._cost", lambda rival: costs[rival.name])
    assert _priced([other, best])[0].name == leads
