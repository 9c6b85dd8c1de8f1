"""Plant an effect, expect its name; plant none, expect silence."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from planted import NOISE, record

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch.calibrate import Background, adjusted, adjusted_groups
from fimpact.mismatch.colour import beside, colour, coloured
from fimpact.mismatch.coordinates import coordinates
from fimpact.mismatch.curves import SPOTS, spots
from fimpact.mismatch.diagnose import diagnose, in_words, to_json, unit_at, verdict
from fimpact.mismatch.discriminate import discriminate
from fimpact.mismatch.disturbance import disturbance
from fimpact.mismatch.evidence import _correlation
from fimpact.mismatch.explain import explain, refit, sizes_of
from fimpact.mismatch.generalised import generalised
from fimpact.mismatch.judge import base_fit, bench
from fimpact.mismatch.locate import _modes, locate
from fimpact.mismatch.name import _serving, build, name
from fimpact.mismatch.nameless import Stranger, differences, nameless, varying
from fimpact.mismatch.naming import Naming
from fimpact.mismatch.pooled import _apart, pooled, stacked
from fimpact.mismatch.price import price, seen
from fimpact.mismatch.problem import Problem, shown
from fimpact.mismatch.pulses import _swings, pulses
from fimpact.mismatch.resolve import resolve
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import proposals, score, screen
from fimpact.mismatch.settle import restarted, settled
from fimpact.mismatch.simulate import Hypothesis, Simulator
from fimpact.mismatch.starts import local_fit, noise_level
from fimpact.mismatch.step import RIVAL, Search, Step, _rivals
from fimpact.mismatch.tame import WILD
from fimpact.mismatch.touch import can_hold, may_stick
from fimpact.mismatch.weigh import both
from fimpact.mismatch.windows import Windows, cut
from fimpact.recordings import Unknown

FRICTION = 0.004  # N m


def hide_friction(model):
    model.dof_frictionloss[1] = FRICTION


@pytest.fixture(scope="module")
def friction():
    return diagnose(record(3, hide_friction))


@pytest.fixture(scope="module")
def nothing():
    return diagnose(record(4))


def few(*names):
    return [EFFECTS[name] for name in names]


def test_a_planted_effect_is_named_where_it_is(friction):
    assert friction.answer == "coulomb@joint_2"
    assert friction.naming.p < 0.01
    assert "coulomb" in friction.verdict and "joint_2" in friction.verdict


def test_its_interval_holds_the_truth_and_is_not_wide(friction):
    row = next(r for r in to_json(friction)["parameters"] if r["of"] == "coulomb@joint_2")
    assert row["low"] < FRICTION < row["high"]
    assert row["high"] - row["low"] < 0.3 * FRICTION


def test_held_out_runs_improve_to_the_noise_floor(friction):
    evidence = friction.evidence
    assert evidence.low > 0 and evidence.explained > 0.9
    assert evidence.after == pytest.approx(evidence.noise_floor, rel=0.05)
    assert abs(evidence.memory_after) < 0.1 < abs(evidence.memory_before)


def test_the_joint_is_located_without_a_catalogue(friction):
    assert friction.location.places[0].name == "joint_2"


def test_noise_alone_belongs_to_no_mode(friction, nothing):
    """Neither the largest of several joints nor the prior that holds a force back may make a force or hide one."""
    noise = np.random.default_rng(0).standard_normal((200, 8, 3))
    found = _modes(noise, np.repeat([["free"] * 8, ["contact"] * 8], 100, 0))
    assert max(found.values()) < 0.1
    assert nothing.location.modes["free"] < 0.4 < friction.location.modes["free"]


def test_silence_when_nothing_is_missing(nothing):
    assert nothing.answer == "none"
    assert nothing.evidence.improvement == pytest.approx(0.0, abs=1e-12)
    assert nothing.evidence.before == pytest.approx(nothing.evidence.noise_floor, rel=0.05)


def test_the_same_recording_gives_the_same_diagnosis(nothing):
    assert to_json(diagnose(record(4))) == to_json(nothing)


def test_the_time_step_is_not_called_physics():
    """Without Richardson's offset the model's own integrator is found as an effect on data in which nothing hides."""
    made = bench(record(5))
    simulator = made.training.simulator
    fitted, _ = base_fit(made, coordinates(simulator), Hypothesis(simulator.theta))
    corrected = fitted.point.squares.sum()
    made.training.offset[:] = 0.0
    point = fitted.point
    bare = made.training.evaluate(point.hypothesis, point.qpos, point.qvel, fitted.coordinates)
    samples = np.isfinite(made.training.windows.measured).sum()
    assert corrected == pytest.approx(samples, rel=0.1)
    assert 2 * bare.cost > 2 * samples


def test_one_shot_score_predicts_the_refit(friction):
    made, simulator = friction.bench, friction.bench.training.simulator
    naive = explain(*base_fit(made, coordinates(simulator), Hypothesis(simulator.theta)))
    tried = proposals(few("coulomb"), made.training, scales(made.training, naive.fitted.point))
    candidate = max(screen(made.training, naive.fitted, tried), key=lambda c: c.gain)
    refitted = refit(made, naive, candidate)
    fall = naive.fitted.point.squares.sum() - refitted.fitted.point.squares.sum()
    assert candidate.gain == pytest.approx(fall, rel=0.1)
    assert candidate.start().values["friction"] == pytest.approx(FRICTION, rel=0.1)
    assert candidate.concealment > 0.8
    assert made.training.simulator.base.dof_frictionloss.max() == 0.0  # the naive model itself is never edited


def test_an_effect_that_is_already_fitted_is_what_its_prior_refuses():
    """Damping is fitted: more of it is a candidate in so far as the fit lies where the prior does not expect it."""
    made = bench(record(4))
    simulator = made.training.simulator
    fitted, _ = base_fit(made, coordinates(simulator), Hypothesis(simulator.theta))
    sizes = scales(made.training, fitted.point)
    tried = proposals(few("viscous"), made.training, sizes)
    found = {c.placed.site: c for c in screen(made.training, fitted, tried)}
    unknown = next(i for i, u in enumerate(made.training.simulator.recording.unknowns) if u.field == "damping")
    site = made.training.simulator.recording.unknowns[unknown].site
    free = fitted.coordinates
    off = (fitted.point.hypothesis.theta[unknown] - free.mean[unknown]) / free.sd[unknown]
    assert found[site].z == pytest.approx(off, abs=0.3)
    assert found[site].hidden > 0.999


def test_a_force_outside_the_catalogue_is_not_given_a_name():
    """A spring, and no spring among the candidates."""

    def hide(model):
        model.jnt_stiffness[1] = 0.3

    found = name(bench(record(6, hide)), few("coulomb", "torque_offset"), lambda line: None)
    assert found.answer == "unnamed"
    assert found.stranger.p < 0.01


def test_p_is_calibrated_under_the_null_and_notices_a_signal():
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((60, 12)) + rng.standard_normal((60, 1))  # correlated, as rivals are
    unit = columns / np.sqrt((columns**2).sum(0))
    quiet, both = Background(60.0, 60), np.ones(12, bool)

    def p(residual):
        return adjusted(residual @ unit, columns, both, quiet)

    alarms = [p(rng.standard_normal(60)).min() <= 0.05 for _ in range(200)]
    assert 0.01 <= np.mean(alarms) <= 0.1
    assert p(rng.standard_normal(60) + 8 * unit[:, 7])[7] < 0.01
    groups = [columns[:, :4], columns[:, 4:8], columns[:, 8:]]
    alarms = [adjusted_groups(groups, rng.standard_normal(60), quiet)[0].min() <= 0.05 for _ in range(200)]
    assert 0.01 <= np.mean(alarms) <= 0.1


def test_a_loud_background_hides_what_it_could_have_made():
    columns = np.random.default_rng(1).standard_normal((60, 5))
    z, both = np.array([6.0, 0, 0, 0, 0]), np.ones(5, bool)
    assert adjusted(z, columns, both, Background(60.0, 60)).min() < 0.01
    assert adjusted(z, columns, both, Background(60.0 * 36, 60)).min() > 0.3


def test_noise_is_read_from_the_data_not_from_a_model():
    recording = record(3, hide_friction)
    assert noise_level(recording) == pytest.approx([NOISE, NOISE], rel=0.1)
    coarse = [replace(run, measured=np.round(run.measured / 0.01) * 0.01) for run in recording.runs]
    assert noise_level(replace(recording, runs=tuple(coarse))) == pytest.approx([0.01 / np.sqrt(12)] * 2, rel=0.5)
    known = replace(recording, noise=np.array([0.5, np.nan]))
    assert noise_level(known)[0] == 0.5


def test_a_designed_experiment_separates_more_than_random_ones(friction):
    naming: Naming = friction.naming
    rivals = [naming.best, naming.steps[0].rivals[1]]
    found = discriminate(friction.bench, friction.recording, rivals)
    assert found.separation > 2 * found.random > 0
    limits = np.concatenate([run.ctrl for run in friction.recording.training])
    assert (found.ctrl >= limits.min(0) - 1e-9).all() and (found.ctrl <= limits.max(0) + 1e-9).all()


def test_a_further_run_resolves_rivals(friction):
    naming, recording = friction.naming, friction.recording
    rivals = [{p.name: p.values for p in e.placed} for e in (naming.steps[0].rivals[1], naming.best)]
    found = resolve(recording, record(3, hide_friction).held_out[:1], rivals)
    assert found[0].name == "coulomb@joint_2" and found[0].weight > 0.9


def test_a_lag_shorter_than_a_step_is_read_at_the_instant_of_the_sample():
    """A torque sensor that is read when the command jumps has not yet seen the jump."""
    recording = record(6, runs=3)
    torque = "<actuatorfrc name='torque' actuator='motor_1'/></sensor>"
    recording = replace(recording, xml=recording.xml.replace("</sensor>", torque), channels=("encoder_1", "torque"))
    windows = cut(recording.runs, 0)
    hypotheses = [
        Hypothesis(Simulator(recording).theta, (Placed(EFFECTS[name], "motor_1", values),) if name else ())
        for name, values in (("", {}), ("actuator_lag", {"time": 8e-4}), ("command_delay", {"delay": 8e-4}))
    ]
    starts = np.zeros((len(windows.runs), 2)), np.zeros((len(windows.runs), 2))
    coarse, fine = (
        [Simulator(recording, finer).predict(hypothesis, windows, *starts)[:, :, 1] for hypothesis in hypotheses]
        for finer in (1, 8)
    )
    for law in (1, 2):
        effect = fine[law] - fine[0]
        assert np.abs(coarse[law] - coarse[0] - effect).max() < 0.2 * np.abs(effect).max()


def test_a_motion_is_not_simulated_again_where_only_what_is_measured_differs(nothing, monkeypatch):
    problem, point = nothing.bench.training, nothing.naming.naive.fitted.point
    simulator, runs = problem.simulator, []
    rollout = simulator._rollout
    monkeypatch.setattr(simulator, "_rollout", lambda *a: runs.append(1) or rollout(*a))
    bias, dry = (
        Placed(EFFECTS["sensor_bias"], "encoder_1", {"offset": 0.1}),
        Placed(EFFECTS["coulomb"], "joint_1", {"friction": 0.1}),
    )
    theta, where = point.hypothesis.theta, (problem.windows, point.qpos + 1e-3, point.qvel)
    plain, biased, rubbed = (simulator.predict(Hypothesis(theta, p), *where) for p in ((), (bias,), (dry,)))
    assert len(runs) == 2
    np.testing.assert_allclose((biased - plain)[..., 0], 0.1)
    np.testing.assert_array_equal(biased[..., 1], plain[..., 1])
    simulator.predict(Hypothesis(theta, (dry,)), problem.windows, point.qpos, point.qvel)
    assert len(runs) == 3 and np.abs(rubbed - plain).max() > 1e-4


def test_a_window_that_jumps_does_not_outweigh_all_others(nothing, monkeypatch):
    """An impact that comes a time step earlier shows at one share of a probe and not at others."""
    problem, fitted = nothing.bench.training, nothing.naming.naive.fitted
    dry = Placed(EFFECTS["coulomb"], "joint_2", {"friction": 0.01})
    (plain,) = screen(problem, fitted, [dry])
    predict = Simulator.predict

    def jumping(self, hypothesis, windows, qpos, qvel, push=None):
        out = predict(self, hypothesis, windows, qpos, qvel, push)
        share = sum(p.values["friction"] for p in hypothesis.placed) / 0.01
        out[(windows.first == 0) & (windows.runs == 0), 5:] += 0.5 * (0.005 < share < 0.02)
        return out

    monkeypatch.setattr(Simulator, "predict", jumping)
    (free,) = screen(problem, fitted, [dry])
    assert free.information > 100 * plain.information
    monkeypatch.setattr("fimpact.mismatch.score.can_touch", lambda model: True)
    (calm,) = screen(problem, fitted, [dry])
    assert calm.information == pytest.approx(plain.information, rel=0.01)


def test_a_window_that_is_stuck_is_begun_anew(nothing):
    problem, fitted = nothing.bench.training, nothing.naming.naive.fitted
    qvel = fitted.point.qvel.copy()
    qvel[3] += 30.0
    lost = problem.evaluate(fitted.point.hypothesis, fitted.point.qpos, qvel, fitted.coordinates)
    found = restarted(problem, fitted.coordinates, lost)
    assert lost.cost > 2 * fitted.point.cost
    assert found.cost < 1.01 * fitted.point.cost
    assert restarted(problem, fitted.coordinates, fitted.point) is fitted.point


def test_a_window_that_is_stuck_where_it_was_measured_is_begun_about_there(nothing, monkeypatch):
    problem, fitted = nothing.bench.training, nothing.naming.naive.fitted
    qvel = fitted.point.qvel.copy()
    qvel[3] += 30.0
    lost = problem.evaluate(fitted.point.hypothesis, fitted.point.qpos, qvel, fitted.coordinates)

    def stuck(part, coordinates, point):
        if np.array_equal(point.qpos, part.starts[0]):
            return part.evaluate(point.hypothesis, lost.qpos[3:4], lost.qvel[3:4], coordinates)
        return settled(part, coordinates, point)

    monkeypatch.setattr("fimpact.mismatch.settle.settled", stuck)
    assert restarted(problem, fitted.coordinates, lost).cost > 2 * fitted.point.cost
    monkeypatch.setattr("fimpact.mismatch.settle.may_stick", lambda *given: True)
    assert restarted(problem, fitted.coordinates, lost).cost < 1.01 * fitted.point.cost


def test_a_motion_that_no_sensor_shows_has_no_sensitivity():
    columns = np.ones((2, 5, 4)) * [1.0, 1e-9, 1e-3, 1e-8]
    assert shown(columns)[:, 0].tolist() == [[1.0, 0.0, 1e-3, 1e-8]] * 2
    assert shown(np.zeros((2, 5, 4))).tolist() == np.zeros((2, 5, 4)).tolist()


def test_what_instruments_are_off_by_is_known_before(nothing):
    scale = Placed(EFFECTS["sensor_scale"], "angle", {"change": 0.02})
    free = coordinates(nothing.bench.training.simulator, (scale,), ({"change": 0.02},))
    assert free.sd[-1] == 0.1 and free.mean[-1] == 0.0


def test_windows_that_are_not_stuck_are_not_simulated_again(nothing, monkeypatch):
    problem, fitted = nothing.bench.training, nothing.naming.naive.fitted
    qvel, simulated = fitted.point.qvel.copy(), set()
    qvel[[3, 5]] += 30.0
    lost = problem.evaluate(fitted.point.hypothesis, fitted.point.qpos, qvel, fitted.coordinates)
    predict = problem.simulator.predict

    def watched(hypothesis, windows, *states):
        simulated.update(zip(windows.runs.tolist(), windows.first.tolist(), strict=True))
        return predict(hypothesis, windows, *states)

    monkeypatch.setattr(problem.simulator, "predict", watched)
    found = restarted(problem, fitted.coordinates, lost)
    stuck = problem.windows.part(np.array([3, 5]))
    assert simulated == set(zip(stuck.runs.tolist(), stuck.first.tolist(), strict=True))
    again = problem.evaluate(found.hypothesis, found.qpos, found.qvel, fitted.coordinates)
    assert found.cost == pytest.approx(again.cost)


def test_a_cap_takes_windows_from_every_run_and_every_part_of_it(nothing):
    runs = nothing.recording.training  # three windows each
    few_ = cut(runs, 80, 9)
    assert len(few_.runs) == len(set(zip(few_.runs, few_.first, strict=True))) == 9
    assert set(few_.runs) == set(range(len(runs))) and set(few_.first) == {0, 80, 160}
    everything = cut(runs, 80)
    for row, (which, first) in enumerate(zip(few_.runs, few_.first, strict=True)):
        same = (everything.runs == which) & (everything.first == first)
        assert np.array_equal(few_.measured[row], everything.measured[same][0])
    assert len(cut(runs, 80, 100).runs) == len(everything.runs)


def test_a_cap_thins_training_windows_and_no_others(nothing):
    recording = replace(nothing.recording, windows=10)
    made = bench(recording)
    assert len(made.training.windows.runs) == 10
    assert len(made.held_out.windows.runs) == len(nothing.bench.held_out.windows.runs)


def test_of_equals_the_first_of_the_catalogue_leads(monkeypatch):
    def rival(name, weight):
        return SimpleNamespace(placed=[SimpleNamespace(effect=SimpleNamespace(name=name))], weight=weight)

    catalogue = [SimpleNamespace(placed=SimpleNamespace(effect=SimpleNamespace(name=n))) for n in ("a", "b", "c")]
    search = Search(None, tuple(catalogue), None, None, print)
    monkeypatch.setattr("fimpact.mismatch.step._void", lambda rival: False)
    for weights, expected in (({"b": 0.5, "a": 0.45, "c": 0.05}, "abc"), ({"b": 0.8, "a": 0.2}, "ba"), ({}, "")):
        rivals = [rival(name, weight) for name, weight in weights.items()]
        monkeypatch.setattr("fimpact.mismatch.step.weigh", lambda bench, pulses, held_out, given: given)
        assert "".join(r.placed[0].effect.name for r in search.ranked(rivals)) == expected


@pytest.mark.parametrize(("dispersion", "expected"), [(1.0, "abc"), (20.0, "adbc")])
def test_a_candidate_that_disturbances_hide_is_refitted_too(monkeypatch, dispersion, expected):
    """Screened, alone against the sensors, and beside what the best leaves: each ranking has its own favourite. Where
    nothing is near the noise, what is screened far behind is asked as well."""
    rankings = {"screened": "a", "sensors": "b", "left": "c"}

    def candidate(name):
        return SimpleNamespace(placed=SimpleNamespace(name=name))

    def stub(name, value):
        monkeypatch.setattr(f"fimpact.mismatch.step.{name}", value)

    def refitted(bench, current, c, worst):
        assert worst == np.inf
        return SimpleNamespace(placed=[c.placed], fitted=None, deviance=1.0, exact=True, loudness=dispersion)

    stub("_by_gain", lambda fitted, given: [candidate(rankings[fitted])])
    stub("shortlist", lambda ranking, most, share=RIVAL: ranking if share == RIVAL else [candidate("d")])
    stub("refit", refitted)
    stub("_worst", lambda rivals: np.inf)
    stub("disturbance", lambda *_: None)
    stub("coloured", lambda *_: "left")
    monkeypatch.setattr(Search, "ranked", lambda self, rivals: rivals)
    search, current = Search(None, (), None, None, lambda _: None), SimpleNamespace(fitted="sensors")
    found = [r.placed[-1].name for r in _rivals(search, current, [candidate("a")], 8)]
    assert sorted(found) == sorted(expected)


def test_only_what_comes_near_the_likeliest_gets_numerics_of_its_own(monkeypatch):
    """And what they change is weighed again, until the likeliest has its own. Where things collide and nothing is near
    the noise, all of them get it."""

    def rival(name, deviance, exact=False, loudness=1.0):
        return SimpleNamespace(name=name, deviance=deviance, exact=exact, loudness=loudness)

    def ranked(self, rivals):
        least = min(r.deviance for r in rivals)
        for r in rivals:
            r.weight = np.exp((least - r.deviance) / 2)
        return sorted(rivals, key=lambda r: r.deviance)

    asked, shifts = [], {"a": 40.0, "b": 0.0, "c": -20.0}

    def corrected(bench, rivals):
        asked.extend(r.name for r in rivals)
        return [rival(r.name, r.deviance + shifts[r.name], True) for r in rivals]

    monkeypatch.setattr(Search, "ranked", ranked)
    monkeypatch.setattr("fimpact.mismatch.step.corrected", corrected)
    simulated = SimpleNamespace(training=SimpleNamespace(simulator=SimpleNamespace(base=None)))
    search = Search(simulated, (), None, None, print)
    found = search.compared([rival("a", 0.0), rival("b", 58.0), rival("c", 50.0), rival("d", np.inf)])
    assert asked == ["a", "c", "b"] and [r.name for r in found] == ["c", "a", "b"]
    asked.clear()
    assert [r.name for r in search.compared([rival("a", 0.0), rival("b", 90.0)])] == ["a", "b"] and asked == ["a"]
    for touching, loudness, expected in ((True, 1.0, "a"), (False, 2 * WILD, "a"), (True, 2 * WILD, "ab")):
        monkeypatch.setattr("fimpact.mismatch.step.can_touch", lambda _, touching=touching: touching)
        asked.clear()
        search.compared([rival("a", 0.0, loudness=loudness), rival("b", 90.0)])
        assert "".join(asked) == expected


@pytest.mark.parametrize(
    ("windows", "dispersion", "misfit", "said"),
    [(3, 50, 1, "none"), (3, 1, 200, "unnamed"), (8, 50, 1, "unnamed"), (8, 1, 200, "unnamed")],
)
def test_a_large_misfit_is_not_passed_over_however_few_the_windows(nothing, windows, dispersion, misfit, said):
    pulses = replace(nothing.naming.pulses, time=np.zeros((windows, 8)))
    assert nothing.naming.misfit == pytest.approx(1.0, rel=0.1)
    assert replace(nothing.naming, pulses=pulses, dispersion=dispersion, misfit=misfit).answer == said


def test_where_nothing_can_be_named_the_error_that_is_left_is_told(nothing):
    off = replace(nothing.evidence, before=4.4 * nothing.evidence.noise_floor)
    parts = nothing.naming, nothing.recording, nothing.location
    assert verdict(*parts, nothing.evidence) == "Nothing is missing that these recordings can show."
    assert "4.4 times the noise off" in verdict(*parts, off)


def test_what_changes_nothing_costs_nothing(nothing):
    bench, current = nothing.bench, nothing.naming.naive
    shift = Placed(EFFECTS["com_shift"], "link_2", {"x": 0.001, "y": 0.001, "z": 0.001})
    columns = bench.training.predict(*moved(current, shift)) - bench.training.predict(*moved(current))
    assert np.abs(columns).max() > 0
    across = replace(shift, values={"x": 0.0, "y": 0.0, "z": 0.001})
    found = screen(bench.training, current.fitted, [shift, across])
    assert [c.placed for c in found] == [shift]
    explained = refit(bench, current, found[0])
    assert list(seen(explained.fitted)) == [True, True, False]
    one = np.log(sum(samples_in(part) for part in explained.parts))
    amplitudes, shapes = price(explained.parts)
    assert one < amplitudes < 2 * one and shapes == 0.0


def test_what_parameters_alone_would_take_is_no_places(nothing):
    fitted, seen = nothing.naming.naive.fitted, nothing.naming.pulses
    step = 300 * fitted.linear.raw[..., 0] / np.linalg.norm(fitted.linear.projected[..., 0])
    off = replace(fitted, point=replace(fitted.point, residual=fitted.point.residual + step))
    assert max(place.share for place in locate(nothing.bench.training, off, seen).places) < 0.5


def test_a_linear_effect_is_tried_at_a_small_share_of_its_probe(nothing, monkeypatch):
    """A payload of ordinary size brings a contact forward: what one window then shows drowns the others."""
    dry = Placed(EFFECTS["coulomb"], "joint_2", {"friction": 1.0})
    limited = Placed(EFFECTS["saturation"], "motor_1", {"limit": 0.01})
    naive, problem, tried = nothing.naming.naive, nothing.bench.training, []
    bare, slight = moved(naive), moved(naive, replace(dry, values={"friction": 0.01}))
    change, predict = problem.predict(*slight) - problem.predict(*bare), problem.predict

    def watched(hypothesis, *states):
        tried.extend(p.values for p in hypothesis.placed)
        return predict(hypothesis, *states)

    monkeypatch.setattr(problem, "predict", watched)
    found = screen(problem, naive.fitted, [dry, limited])
    assert tried == [{"friction": 0.01}, {"limit": 0.01}]
    assert np.linalg.norm(found[0].change) == pytest.approx(100 * np.linalg.norm(change), rel=1e-6)


def test_what_a_probe_leaves_at_zero_can_be_moved(nothing):
    values = {"stiffness": 0.1, "anchor_x": -0.6, "anchor_y": 0.0, "anchor_z": 0.0}
    cable = Placed(EFFECTS["cable_pull"], "link_2", values)
    assert sizes_of(cable) == {"stiffness": 0.1, "anchor_x": 0.6, "anchor_y": 0.6, "anchor_z": 0.6}
    ripple = Placed(EFFECTS["torque_ripple"], "joint_2", {"sine": 0.01, "cosine": 0.0, "cycles": 8.0})
    (found,) = screen(nothing.bench.training, nothing.naming.naive.fitted, [ripple])
    assert refit(nothing.bench, nothing.naming.naive, found).placed[0].values["cosine"] != 0.0


def test_what_no_probe_moves_is_held(nothing):
    """Of a planar arm, a tilt about gravity's own axis and an anchor out of its plane are nothing to fit."""
    bench, naive = nothing.bench, nothing.naming.naive
    tried = proposals(few("cable_pull", "torque_ripple"), bench.training, scales(bench.training, naive.fitted.point))
    found = {p.effect.name: p for p in tried}
    assert len(found["cable_pull"].held) == 1 and found["cable_pull"].held[0].startswith("anchor")
    assert found["torque_ripple"].held == []
    (candidate,) = screen(bench.training, naive.fitted, [found["cable_pull"]])
    explained = refit(bench, naive, candidate)
    assert found["cable_pull"].held[0] not in [name for _, name in explained.fitted.coordinates.values]
    assert seen(explained.fitted).sum() == 3


def test_a_shape_stays_where_it_means_something(nothing):
    """A spring that is slack only many turns away is a constant torque, and a cable from far off is gravity."""
    bench, naive = nothing.bench, nothing.naming.naive
    typical = scales(bench.training, naive.fitted.point)
    tried = proposals(few("spring", "cable_pull"), bench.training, typical)
    spring = next(p for p in tried if p.name == "spring@joint_2")
    middle, far = typical.middle[1], max(np.pi, 4 * typical.travel[1])
    assert spring.ranges["rest"] == pytest.approx((middle - far, middle + far))
    free = coordinates(bench.training.simulator, (spring,), (sizes_of(spring),))
    there = free.write(Hypothesis(naive.fitted.point.hypothesis.theta, (spring,)), np.append(free.low[:-1], 99.0))
    assert there.placed[0].values["rest"] == pytest.approx(middle + far)
    cable = next(p for p in tried if p.effect.name == "cable_pull")
    assert [high - low for low, high in cable.ranges.values()] == pytest.approx([6 * typical.length] * 3)


def moved(explanation, *placed):
    point = explanation.fitted.point
    return Hypothesis(point.hypothesis.theta, placed), point.qpos, point.qvel


def samples_in(part):
    return (part.point.residual != 0).sum()


@pytest.fixture(scope="module")
def asked(nothing):
    """What `nameless` makes of the null recording once a residual, (w, m) each, is added in its windows."""
    made, naive, found = nothing.bench, nothing.naming.naive, nothing.naming.pulses
    held_out, tried = pulses(made.held_out, naive.judged), list(nothing.naming.steps[0].screened)

    def ask(learned=0.0, shown=0.0, candidates=tried):
        parts = [
            replace(part, point=replace(part.point, residual=part.point.residual + added))
            for part, added in zip(naive.parts, (learned, shown), strict=True)
        ]
        explanation = replace(naive, fitted=parts[0], judged=parts[1])
        fitted, everywhere = pooled(both(made, explanation), found, held_out)
        return nameless(made, explanation, coloured(fitted, everywhere), everywhere, candidates)

    return SimpleNamespace(ask=ask, learned=found, shown=held_out, tried=tried)


def test_what_is_alike_in_all_training_runs_differs_in_none(nothing, asked):
    """Held-out windows know the coordinates too, and what is projected off depends on them."""
    made, naive, n = nothing.bench, nothing.naming.naive, len(nothing.bench.training.windows.runs)
    fitted, _ = pooled(both(made, naive), asked.learned, asked.shown)
    gain = next(c for c in asked.tried if c.placed.name == "gain@motor_2")
    (apart,) = varying(made.training, fitted, [gain]).values()
    common = fitted.linear.off(stacked(gain.change, np.zeros((len(asked.shown.time), gain.change.shape[1]))))
    assert np.abs(apart.T @ common.ravel()).max() < 1e-6 * np.linalg.norm(common[:n])
    assert np.linalg.norm(apart, axis=0).min() > 0.8


def test_an_effect_that_differs_from_run_to_run_has_no_name(nothing, asked):
    runs = nothing.bench.training.windows.runs
    assert asked.ask().p > 0.01
    gain = next(c for c in asked.tried if c.placed.name == "gain@motor_2")
    added = 30 * np.where(runs % 2, 1.0, -1.0)[:, None] * gain.change / np.linalg.norm(gain.column)
    assert asked.ask(added, candidates=[]).p > 0.01
    found = asked.ask(added)
    assert found.p < 0.01
    assert found.like == "gain at motor_2, of a strength that differs from run to run"


@pytest.mark.parametrize(
    ("like", "force"),
    [
        ("a force on joint_2 that goes with the time since a run began", lambda own: np.tanh(own.time)),
        ("a force on joint_2 that goes with the commands", lambda own: own.ctrl[..., 0]),
        (
            "an effect of the command on joint_2 that goes with the time since a run began",
            lambda own: own.ctrl[..., 1] * np.tanh(own.time),
        ),
        ("something that swings unseen and pulls joint_2 along", lambda own: own.swing[:, :, 1, 2]),
        ("a force for a moment, about", lambda own: np.exp(-(((own.time - 1.0) / 0.05) ** 2))),
        ("a force on joint_2 that comes and goes every", lambda own: np.sin(20 * own.time)),
        (
            "an effect of the command on joint_2 that comes and goes every",
            lambda own: own.ctrl[..., 1] * np.sin(20 * own.time),
        ),
    ],
)
def test_a_force_without_a_name_is_told_by_what_it_goes_with(asked, like, force):
    learned, shown = (own.along(1, force(own)) for own in (asked.learned, asked.shown))
    size = 200 / np.linalg.norm(learned)
    found = asked.ask(size * learned, size * shown)
    assert found.p < 0.001
    assert found.like.startswith(like)


def test_held_out_windows_are_asked_as_well(asked):
    force = asked.shown.along(1, asked.shown.swing[:, :, 1, 2])
    found = asked.ask(shown=400 * force / np.linalg.norm(force))
    assert found.p < 0.001


def test_windows_of_unequal_length_are_pooled():
    np.testing.assert_array_equal(stacked(np.ones((1, 2, 2)), np.ones((1, 1, 2)))[1], [[1, 1], [0, 0]])
    apart = _apart(np.ones((2, 3, 1)), 2 * np.ones((1, 2, 2)))
    np.testing.assert_array_equal(apart[0, 0], [1, 0, 0])
    np.testing.assert_array_equal(apart[2], [[0, 2, 2], [0, 2, 2], [0, 0, 0]])


def test_what_swings_is_carried_from_window_to_window_and_not_across_a_gap():
    speed = np.random.default_rng(0).standard_normal((1, 33, 2)).cumsum(1)
    whole = Windows(np.zeros(1, int), np.zeros(1, int), np.zeros((1, 32, 1)), np.zeros((1, 33, 0)), ("run",))
    halves = replace(whole, runs=np.zeros(2, int), first=np.array([0, 16]), measured=np.zeros((2, 16, 1)))
    cut_in_two = np.concatenate([speed[:, :17], speed[:, 16:]])
    long = _swings(whole, speed, 0.01)
    short = _swings(halves, cut_in_two, 0.01)
    np.testing.assert_allclose(short[1].reshape(4, 2, 2, -1).mean(1), long[0, 4:], rtol=1e-9)
    alone = _swings(replace(halves, first=np.array([0, 20])), cut_in_two, 0.01)
    np.testing.assert_allclose(alone[1], _swings(replace(halves, runs=np.arange(2)), cut_in_two, 0.01)[1])
    assert not np.allclose(alone[1], short[1])


def test_spots_cover_the_postures_whatever_their_units():
    rng = np.random.default_rng(0)
    posture = np.stack([rng.uniform(-1, 1, (20, 8)), 1e3 * rng.uniform(-1, 1, (20, 8))], 2)
    found = spots(posture)
    assert len(found) == SPOTS and found[0].shape == (20, 8)
    assert np.max(found, 0).min() > 0.1 and np.min(found, 0).max() < 0.9
    assert len(spots(np.zeros((20, 8, 2)))) == 1
    posture[0, 0] = 1e3, 1e6  # a motion that escapes must not make one spot of all others
    assert np.ptp(spots(posture), axis=(1, 2)).max() > 0.9
    assert np.median([np.ptp(spot[1:]) for spot in spots(posture)]) > 0.5


def test_what_is_alike_in_all_runs_is_no_difference():
    rng = np.random.default_rng(0)
    column, runs = rng.standard_normal((6, 5)), np.array([0, 0, 2, 2, 2, 5])
    apart = differences(column, runs)
    assert apart.shape == (30, 2)
    np.testing.assert_allclose(apart.T @ column.ravel(), 0, atol=1e-12)
    assert differences(column, np.zeros(6)).shape == (30, 0)


@pytest.mark.parametrize("loudness", [0.5 * WILD, 2 * WILD])
def test_effects_that_make_each_other_superfluous_do_not_take_turns_for_ever(monkeypatch, loudness):
    def explained(name):
        placed = [SimpleNamespace(at_limit=False) for _ in name.split("+")]
        return SimpleNamespace(name=name, placed=placed, fitted=SimpleNamespace(point=None), loudness=loudness)

    rounds = iter(["payload", "com_shift+payload", "com_shift+payload"])
    left = iter(["com_shift", "payload"])

    def stub(name, value):
        monkeypatch.setattr(f"fimpact.mismatch.name.{name}", value)

    stub("step", lambda *_, alarm: Step([], np.zeros(0), [explained(next(rounds))]))
    stub("_reconsider", lambda *_: [explained(next(left))])
    stub("_learned", lambda *_: 0.0)
    stub("hopeful", lambda _, rivals: rivals)
    stub("worthwhile", lambda *_: True)
    stub("beats", lambda *_: True)
    stub("accepted", lambda _, __, explanation: explanation)
    stub("_astray", lambda *_: False)
    naive = explained("none")
    naive.placed = ()
    steps, best, _ = build(Search(None, (), None, None, print), naive)
    assert best.name == "com_shift"
    assert len(steps) == 3


def accepting(monkeypatch, rivals, worthwhile, stubs=()):
    """What `_serving` takes of `rivals` if `worthwhile` judges their leader."""
    for stub, value in (
        ("hopeful", lambda _, rivals: rivals),
        ("worthwhile", lambda _, __, ___, last: worthwhile(last.rivals[0])),
        ("beats", lambda *_: True),
        ("accepted", lambda _, __, explanation: explanation),
        *dict(stubs).items(),
    ):
        monkeypatch.setattr(f"fimpact.mismatch.name.{stub}", value)
    search = SimpleNamespace(ranked=lambda rivals: rivals)
    found = _serving(search, None, None, Step([], np.zeros(0), rivals), {"none"})
    return found and found[0].name


@pytest.mark.parametrize(("dispersion", "expected"), [(0.5 * WILD, None), (2 * WILD, "second")])
def test_where_nothing_is_near_the_noise_the_next_is_asked(monkeypatch, dispersion, expected):
    """What one step promises is an order to rely on only where the steps end near the noise."""
    rivals = [SimpleNamespace(name=name, placed=(None,), loudness=dispersion) for name in ("first", "second")]
    assert accepting(monkeypatch, rivals, lambda leader: leader.name == "second") == expected


@pytest.mark.parametrize(("dispersion", "expected"), [(0.5 * WILD, "superfluous"), (2 * WILD, "better")])
def test_where_nothing_is_near_the_noise_what_really_predicts_better_is_asked(monkeypatch, dispersion, expected):
    """Reconsidered, what leads may promise more and not keep it; beside it is what does without the superfluous."""
    promising, better, superfluous = (
        SimpleNamespace(name=name, placed=(None, None), loudness=dispersion)
        for name in ("promising", "better", "superfluous")
    )
    monkeypatch.setattr("fimpact.mismatch.name._reconsider", lambda *_: [promising, better])
    refuse = {"accepted": lambda _, __, explanation: None if explanation is promising else explanation}
    assert accepting(monkeypatch, [superfluous], lambda _: True, refuse) == expected


@pytest.mark.parametrize(
    ("lost", "dispersion", "asked"), [(False, 1.0, False), (False, 2 * WILD, True), (True, 1.0, True)]
)
def test_pairs_are_asked_for_where_no_one_effect_comes_near_the_noise(monkeypatch, lost, dispersion, asked):
    def explained(name):
        placed = [SimpleNamespace(at_limit=False)] if name != "none" else ()
        return SimpleNamespace(name=name, placed=placed, fitted=SimpleNamespace(point=None), loudness=dispersion)

    paired = []
    for stub, value in (
        ("step", lambda *_, alarm: Step([], np.zeros(0), [explained("drag")])),
        ("_learned", lambda *_: 0.0),
        ("_further", lambda *_: None),
        ("lost", lambda _: lost),
        ("together", lambda *_: paired.append("asked")),
    ):
        monkeypatch.setattr(f"fimpact.mismatch.name.{stub}", value)
    build(Search(None, (), None, None, print), explained("none"))
    assert bool(paired) is asked


def shaken(fitted, by):
    """`fitted` with each window's residual multiplied by `by`, (w,)."""
    return replace(fitted, point=replace(fitted.point, residual=fitted.point.residual * by[:, None]))


def test_what_was_known_before_counts(nothing):
    """A rival may not bend a mass far from what is known of it for nothing."""
    fitted, found = nothing.naming.naive.fitted, nothing.naming.pulses
    shade, free = [colour(found, disturbance(fitted, found))], fitted.coordinates
    strict = replace(free, mean=free.read(fitted.point.hypothesis) + 50 * free.sd)
    pull = (free.read(fitted.point.hypothesis) - strict.mean) / free.sd**2
    calm, bent = generalised([fitted], shade), generalised([replace(fitted, coordinates=strict, pull=pull)], shade)
    assert calm.bent < 20 < bent.bent
    assert bent.total == pytest.approx(sum(part.sum() for part in bent.deviances) + bent.bent)


def test_what_no_window_shows_is_not_known(nothing):
    """Its variance is huge, and not none: a shape of which nothing is seen must not be paid for as if it were known."""
    fitted, found = nothing.naming.naive.fitted, nothing.naming.pulses
    free, linear = fitted.coordinates, fitted.linear
    hidden = np.arange(len(free.scale)) > 0
    unseen = replace(linear, raw=linear.raw * hidden, projected=linear.projected * hidden)
    alone = replace(fitted, linear=unseen, coordinates=replace(free, sd=np.where(hidden, free.sd, np.inf)))
    shade = [colour(found, disturbance(fitted, found))]
    error = np.sqrt(np.diag(generalised([alone], shade).covariance)) / free.scale
    assert error[0] > 1e3 * error[1:].max()
    known = np.sqrt(np.diag(generalised([fitted], shade).covariance)) / free.scale
    assert (error[1:] < 1.01 * known[1:]).all()


def test_where_no_window_shows_an_unknown_candidates_are_scored_all_the_same(nothing):
    fitted = nothing.naming.naive.fitted
    k, linear = len(fitted.coordinates.scale), fitted.linear
    blind = replace(linear, raw=0 * linear.raw, projected=0 * linear.projected)
    lost = replace(fitted, linear=blind, precision=np.zeros((k, k)), pull=np.zeros(k))
    assert np.isfinite(score(lost, nothing.naming.steps[0].screened[0].placed, linear.raw[..., 0]).information)


def test_noise_alone_is_nobodys(nothing):
    places = nothing.location.places
    assert max(place.share for place in places) < 0.5 and min(place.share for place in places) >= 0
    slower = [replace(run, measured=np.where(np.arange(len(run.measured))[:, None] % 3, np.nan, run.measured))
              for run in nothing.recording.runs]  # fmt: skip
    made = bench(replace(nothing.recording, runs=tuple(slower), noise=np.full(2, NOISE)))
    fitted, _ = base_fit(made, coordinates(made.training.simulator), Hypothesis(made.training.simulator.theta))
    assert max(place.share for place in locate(made.training, fitted, pulses(made.training, fitted)).places) < 0.5


def test_a_candidate_whose_motion_diverges_begins_weaker_or_is_none(friction, monkeypatch):
    made, naive, plain = friction.bench, friction.naming.naive, Problem.evaluate
    largest = 0.6 * FRICTION

    def evaluate(problem, hypothesis, *rest):
        point = plain(problem, hypothesis, *rest)
        wild = any(placed.values["friction"] > largest for placed in hypothesis.placed)
        return replace(point, residual=np.nan * point.residual, cost=np.inf) if wild else point

    monkeypatch.setattr(Problem, "evaluate", evaluate)
    tried = proposals(few("coulomb"), made.training, scales(made.training, naive.fitted.point))
    strongest = max(screen(made.training, naive.fitted, tried), key=lambda c: c.gain)
    found = refit(made, naive, strongest)
    assert found.deviance < naive.deviance and 0 < found.placed[0].values["friction"] <= largest
    largest = -1.0
    assert refit(made, naive, strongest).deviance == np.inf


def test_a_start_is_read_from_the_nearest_samples_of_a_slow_sensor():
    time = 0.001 * np.arange(2000)
    signal = np.where(np.arange(2000) % 50 == 0, 1 + 2 * time, np.nan)
    assert local_fit(signal, 777, 0.001, 1e-6) == pytest.approx((1 + 2 * 0.777, 2.0))
    assert local_fit(np.full(9, np.nan), 3, 0.001, 1.0) is None
    assert local_fit(np.array([np.nan, 4.0]), 0, 0.001, 1.0) == (4.0, 0.0)


def test_an_unknown_and_an_effect_of_one_name_are_told_apart(nothing):
    made, naive = nothing.bench, nothing.naming.naive
    unknowns = (Unknown("inertia", "link_1"), *nothing.recording.unknowns[1:])
    recording = replace(nothing.recording, unknowns=unknowns)
    tried = proposals(few("inertia"), made.training, scales(made.training, naive.fitted.point))
    best = refit(made, naive, next(c for c in screen(made.training, naive.fitted, tried) if c.placed.site == "link_1"))
    naming = replace(nothing.naming, best=best, covariance=np.eye(len(best.fitted.coordinates.scale)))
    assert "inertia at link_1 (change" in in_words(naming, recording, best.placed[0])


def test_a_residual_of_a_slow_channel_remembers_in_samples_of_its_own():
    error = np.repeat(np.random.default_rng(0).standard_normal((50, 10)), 2, 1)  # each value twice
    seen = np.ones_like(error, bool)
    slow, gaps = np.zeros((50, 120)), np.zeros((50, 120), bool)
    slow[:, ::6], gaps[:, ::6] = error, True
    assert _correlation(slow, gaps, 1) == pytest.approx(_correlation(error, seen, 1)) == pytest.approx(0.5, abs=0.1)


def test_what_no_force_explains_may_be_louder_than_the_sensors(nothing):
    fitted, found = nothing.naming.naive.fitted, nothing.naming.pulses
    every = np.ones(len(fitted.point.residual))
    quiet, loud = (disturbance(shaken(fitted, size * every), found) for size in (1.0, 4.0))
    assert quiet.noise == pytest.approx(1.0, abs=0.1)
    assert loud.noise == pytest.approx(4.0 * quiet.noise, rel=0.1)


def test_a_missing_effect_does_not_hide_in_the_disturbance_that_it_is_taken_for(friction):
    fitted, found = friction.naming.naive.fitted, friction.naming.pulses
    strongest = friction.naming.steps[0].screened[0]
    assert beside(fitted, found, strongest.change).sd.max() < disturbance(fitted, found).sd.max() / 4


def test_one_loud_window_decides_nothing(nothing):
    fitted, found = nothing.naming.naive.fitted, nothing.naming.pulses
    shade = colour(found, disturbance(fitted, found))
    size = np.ones(len(fitted.point.residual))
    calm = generalised([fitted], [shade])
    size[0] = 100.0
    loud = generalised([shaken(fitted, size)], [shade])
    moved = np.abs(loud.step - calm.step) / np.sqrt(np.diag(calm.covariance))
    assert moved.max() < 3
    assert loud.squares[0][0] > 1000 * calm.squares[0][0]
    assert loud.deviances[0][0] < 20 * calm.deviances[0][0]
    np.testing.assert_allclose(calm.deviances[0], calm.squares[0], rtol=0.1)


def test_the_verdict_names_nothing_for_sure_that_held_out_runs_refuse(friction):
    refused = replace(friction.evidence, low=-0.01)
    assert verdict(friction.naming, friction.recording, friction.location, friction.evidence).startswith("Missing")
    said = verdict(friction.naming, friction.recording, friction.location, refused)
    assert "does not improve held-out runs" in said
    assert not said.startswith("Missing")


@pytest.mark.parametrize(
    ("p", "left", "said"),
    [
        (0.001, 0.1, "Something beside it is missing that the catalogue cannot name. It is most like a ghost."),
        (0.04, 0.1, "Something beside it may be missing that the catalogue cannot name. It is most like a ghost."),
        (0.9, 0.3, "These recordings cannot rule out that more is missing."),
        (0.9, 0.1, "held-out mismatch."),
    ],
)
def test_the_verdict_says_how_sure_it_is_that_this_is_all(friction, p, left, said):
    naming = replace(friction.naming, stranger=Stranger(p, 1.0, "a ghost"), left=left)
    assert verdict(naming, friction.recording, friction.location, friction.evidence).endswith(said)


@pytest.mark.parametrize(("p", "certain"), [(0.9, 0), (0.04, 1), (0.001, 1)])
def test_the_verdict_says_of_a_name_that_was_only_suspected_that_it_could_be_chance(friction, monkeypatch, p, certain):
    monkeypatch.setattr(Naming, "p", 0.03)
    naming = replace(friction.naming, stranger=Stranger(p, 1.0, "a ghost"), left=0.1)
    chance = " That something is missing is certain, but by itself this name could be chance."
    said = verdict(naming, friction.recording, friction.location, friction.evidence)
    assert said.count(chance) == 1 and said.count("ghost") == certain
    monkeypatch.setattr(Naming, "answer", "unnamed")
    said = verdict(naming, friction.recording, friction.location, friction.evidence)
    assert f"{chance} More is missing that" in said


def test_the_verdict_tells_what_has_a_name_beside_what_has_none(friction, monkeypatch):
    monkeypatch.setattr(Naming, "answer", "unnamed")
    said = verdict(friction.naming, friction.recording, friction.location, friction.evidence)
    assert said.startswith("Missing: coulomb at joint_2 (friction 0.00")
    assert "More is missing that the catalogue cannot name: " in said
    refused = replace(friction.evidence, low=-0.01)
    said = verdict(friction.naming, friction.recording, friction.location, refused)
    assert said.startswith("Something is missing that the catalogue cannot name")
    assert ". The likeliest name does not improve held-out runs: coulomb at joint_2 (" in said
    nothing = replace(friction.naming, best=friction.naming.naive, members=[])
    said = verdict(nothing, friction.recording, friction.location, friction.evidence)
    assert said.endswith(". The likeliest name does not improve held-out runs: coulomb at joint_2.")


SLED = """<mujoco><worldbody><body name="sled"><joint name="rail" type="slide"/><geom size="0.1"/>
<body name="arm"><joint name="hinge"/><geom size="0.1"/></body></body></worldbody>
<actuator><motor name="pusher" joint="rail"/><motor name="turner" joint="hinge"/></actuator>
<sensor><framepos name="camera" objtype="body" objname="sled"/><jointvel name="speed" joint="hinge"/>
<framequat name="turn" objtype="body" objname="arm"/></sensor></mujoco>"""


@pytest.mark.parametrize(
    ("of", "unit", "expected"),
    [
        ("viscous@rail", "N m s/rad", "N s/m"),
        ("joint_elasticity@rail", "rad/(N m)", "m/N"),
        ("rotor_inertia@rail", "kg m²", "kg"),
        ("torque_offset@pusher", "N m", "N"),
        ("viscous@hinge", "N m s/rad", "N m s/rad"),
        ("torque_offset@turner", "N m", "N m"),
        ("mass@sled", "kg", "kg"),
        ("inertia@rail", "kg m^2", "kg m^2"),
        ("misalignment@rail", "rad", "rad"),
        ("sensor_bias@camera[2]", "of the channel", "m"),
        ("sensor_bias@speed", "of the channel", "rad/s"),
        ("sensor_bias@turn[0]", "of the channel", "of the channel"),
    ],
)
def test_units_are_those_of_the_joint_or_the_channel(of, unit, expected):
    assert unit_at(mujoco.MjSpec.from_string(SLED), of, unit) == expected


@pytest.mark.parametrize(("unit", "said"), [("1", "change 2.51 ± 2"), ("N m", "change 2.51 ± 2 N m")])
def test_a_ratio_is_said_without_a_unit(monkeypatch, unit, said):
    row = {"name": "change", "of": "gain@drive", "unit": unit, "before": None, "after": 2.51, "low": 0.51, "high": 4.51}
    monkeypatch.setattr("fimpact.mismatch.diagnose.parameter_rows", lambda *_: [row])
    placed = Placed(EFFECTS["gain"], "drive", {"change": 2.51})
    assert in_words(None, None, placed) == f"gain at drive ({said})"


HELD = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body>
      <joint name="turn" axis="0 1 0" {joint}/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02" {geom}/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    ("joint", "geom", "held"),
    [
        ("", 'contype="0"', False),
        ('frictionloss="0.1"', 'contype="0"', True),
        ('range="-1 1" limited="true"', 'contype="0"', True),
        ("", "", True),
    ],
)
def test_what_may_be_held_needs_a_solver(joint, geom, held):
    assert can_hold(mujoco.MjModel.from_xml_string(HELD.format(joint=joint, geom=geom))) is held


@pytest.mark.parametrize(
    ("effect", "sticks"),
    [("viscous", False), ("torque_ripple", False), ("coulomb", True), ("dahl", True), ("efficiency", True)],
)
def test_under_dry_friction_of_any_kind_a_free_joint_may_stick(effect, sticks):
    model = mujoco.MjModel.from_xml_string(HELD.format(joint="", geom='contype="0"'))
    assert may_stick(model, Hypothesis(np.zeros(0), (Placed(EFFECTS[effect], "turn", {}),))) is sticks
    assert not may_stick(model, Hypothesis(np.zeros(0)))


def test_without_a_solver_what_nothing_holds_moves_as_with_it(nothing, monkeypatch):
    problem, point = nothing.bench.training, nothing.naming.naive.fitted.point

    def predicted():
        simulator = Simulator(problem.simulator.recording)
        return simulator.predict(point.hypothesis, problem.windows, point.qpos, point.qvel)

    alone = predicted()
    monkeypatch.setattr("fimpact.mismatch.simulate.can_hold", lambda model: True)
    assert not can_hold(problem.simulator.base) and np.array_equal(alone, predicted())
