"""The planting side: what is drawn is what was asked for, is sealed, and can be played again."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from fimpact.benchmark import generator
from fimpact.benchmark.archive import cases_in, load_recording, save_recording
from fimpact.benchmark.drawing import draw_case as draw
from fimpact.benchmark.drawing.detectability import visibility_of, whitener
from fimpact.benchmark.drawing.draw_case import draw_case
from fimpact.benchmark.drawing.effect_size import set_stage, trace
from fimpact.benchmark.drawing.motions import draw_motion
from fimpact.benchmark.drawing.separable import SPLIT, best_split
from fimpact.benchmark.drawing.tangents import cut, gather, models, predict, tangents
from fimpact.benchmark.planting import planted_effects
from fimpact.benchmark.planting.confusable_pairs import TWINS
from fimpact.benchmark.planting.ground_truth import compiled, new_world, play
from fimpact.benchmark.planting.out_of_catalogue import STRANGERS, known, plant
from fimpact.benchmark.rigs.registry import RIGS, rig_of
from fimpact.benchmark.seal import open_seal, robot, write_case
from fimpact.benchmark.truth import as_json, from_json, run_on_robot
from fimpact.effects import EFFECTS

EVERYTHING = [(rig, name) for name, p in (planted_effects.PLANTS | STRANGERS).items() for rig in p.sites]


@pytest.fixture(scope="module")
def case():
    """A recording with one effect, and its truth."""
    return draw_case(0, "single", seed=3, system="arm_free")


@pytest.fixture(scope="module")
def motions():
    """Motions of every rig."""
    return {name: draw_motion(rig, np.random.default_rng(5)) for name, rig in RIGS.items()}


def written(folder, case):
    write_case("001", *case, folder / "recordings", folder / "sealed")
    return folder / "recordings", folder / "sealed"


def test_every_plant_is_of_the_catalogue_and_sits_where_it_can():
    assert set(planted_effects.PLANTS) <= set(EFFECTS)
    for name, entry in planted_effects.PLANTS.items():
        for rig, places in entry.sites.items():
            allowed = EFFECTS[name].sites(RIGS[rig].naive, RIGS[rig].channels)
            assert set(places) <= set(allowed), f"{name} in {rig}"


def test_every_run_begins_on_the_same_ground():
    rig = RIGS["block"]
    world = new_world(rig, np.zeros(len(rig.unknowns)), fine=False)
    plant(world, "wavy_ground", known("wavy_ground").sites["block"][0], {"height": 0.01, "length": 0.3})
    motion = draw_motion(rig, np.random.default_rng(5))
    start, ctrl = np.tile(motion.start[:1], (3, 1)), np.tile(motion.ctrl[:1], (3, 1, 1))
    runs = play(world, start, ctrl).samples
    np.testing.assert_array_equal(runs[1:], runs[:1].repeat(2, 0))


def test_every_effect_is_asked_to_hide_in_one_pass_or_the_next():
    pool = sum(len(entry.sites) for entry in planted_effects.PLANTS.values())
    asked = np.array([draw.must_be_hidden(i, None) for i in range(2 * pool)]).reshape(2, -1)
    assert (asked.sum(0) == 1).all()


def test_at_least_eight_kinds_are_outside_the_catalogue():
    assert len(STRANGERS) >= 8 and not set(STRANGERS) & set(EFFECTS)


@pytest.mark.parametrize(("system", "name"), EVERYTHING)
def test_every_plant_changes_what_is_recorded(motions, system, name):
    rig, entry, motion = RIGS[system], known(name), motions[system]
    rng, site = np.random.default_rng(2), entry.sites[system][0]
    values = entry.values(entry.span(rig)[1] / 2, **entry.shape(rng, rig, motion, site))
    worlds = [new_world(rig, np.zeros(len(rig.unknowns)), fine=False) for _ in range(2)]
    plant(worlds[1], name, site, values)
    with_it, without = (play(w, motion.start[:3], motion.ctrl[:3]).samples for w in worlds[::-1])
    assert np.abs((with_it - without) / rig.sd).max() > 1


@pytest.mark.parametrize("system", RIGS)
def test_a_world_without_anything_planted_is_the_naive_model(motions, system):
    rig, motion = RIGS[system], motions[system]
    played = play(new_world(rig, np.zeros(len(rig.unknowns)), fine=False), motion.start[:1], motion.ctrl[:1])
    model, data = rig.naive, mujoco.MjData(rig.naive)
    data.qpos[:], data.qvel[:] = np.split(motion.start[0], 2)
    for k in range(20):
        data.ctrl[:] = motion.ctrl[0, k]
        mujoco.mj_forward(model, data)
        assert data.sensordata[rig.columns] == pytest.approx(played.samples[0, k], abs=1e-9)
        mujoco.mj_step(model, data, rig.coarse)


@pytest.mark.parametrize("system", RIGS)
def test_the_truth_steps_at_least_ten_times_finer(system):
    assert RIGS[system].fine >= 10 * RIGS[system].coarse
    assert RIGS[system].period / RIGS[system].coarse == pytest.approx(RIGS[system].naive.opt.timestep)


def test_a_shaft_with_play_stops_where_its_play_ends(motions):
    rig, gap = rig_of("arm_free"), 0.004
    world = new_world(rig, np.zeros(len(rig.unknowns)), fine=True)
    plant(world, "backlash", "joint_2", {"gap": gap})
    model = compiled(world)
    data, lead = mujoco.MjData(model), []
    for ctrl in np.repeat(motions["arm_free"].ctrl[0], world.steps, axis=0):
        data.ctrl = ctrl
        mujoco.mj_step(model, data)
        lead.append(abs(data.joint("joint_2_behind").qpos[0]) / (gap / 2))
    assert np.median(lead) == pytest.approx(1, abs=0.01)
    assert np.quantile(lead, 0.99) < 1.2


@pytest.mark.parametrize("written", [False, True])
def test_behind_a_gear_that_gives_are_all_of_the_joints_friction_and_a_gap_in_radians(written):
    """In a file by hand, in degrees, and in what MuJoCo has written of it, in radians."""
    rig = rig_of("arm_free")
    if written:
        spec = mujoco.MjSpec.from_string(rig.xml)
        spec.compile()
        rig = replace(rig, text=spec.to_xml())
    world = new_world(rig, np.zeros(len(rig.unknowns)), fine=True)
    world.spec.joint("joint_2").frictionloss = 0.3
    plant(world, "backlash", "joint_2", {"gap": 0.004})
    model = compiled(world)
    assert model.joint("joint_2_behind").range == pytest.approx([-0.002, 0.002])
    assert model.joint("joint_2").frictionloss == 0 == model.joint("joint_2").damping
    assert model.tendon_frictionloss == pytest.approx(0.3) and model.tendon_damping[0] == pytest.approx(0.06)


@pytest.mark.parametrize("system", RIGS)
def test_motions_stay_within_reach_and_meet_the_surface(motions, system):
    rig, motion = RIGS[system], motions[system]
    played = play(new_world(rig, np.zeros(len(rig.unknowns)), fine=False), motion.start, motion.ctrl)
    if rig.throws():
        hit = np.abs(played.samples[:, :, 3:]).max(axis=2) > 20
        assert hit.any(axis=1).all() and not hit[:, 0].any()
    else:
        assert np.abs(played.samples[:, :, :3]).max() < 3.5
        assert np.ptp(played.samples[:, :, :3], axis=1).max(axis=1).min() > 0.3
    if system == "arm_contact":
        share = (np.abs(played.samples[:, :, 3:]).max(axis=2) > 3).mean(axis=1)
        assert share.min() > 0.1 and share.max() < 0.9


def test_equal_seeds_give_equal_bytes(case, tmp_path):
    again = draw_case(0, "single", seed=3, system="arm_free")
    for folder, pair in (("a", case), ("b", again)):
        written(tmp_path / folder, pair)
    for name in ("recordings/001/recording.npz", "recordings/001/model.xml", "recordings/001/seal.txt"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert (tmp_path / "a/sealed/001/truth.json").read_bytes() == (tmp_path / "b/sealed/001/truth.json").read_bytes()


def test_another_seed_gives_another_case(case):
    other, _ = draw_case(0, "single", seed=4, system="arm_free")
    assert not np.array_equal(other.runs[0].measured, case[0].runs[0].measured)


@pytest.mark.parametrize("target", [10.0, 1000.0])
def test_the_size_is_the_one_that_was_asked_for(target):
    _, truth = draw_case(6, "single", seed=1, system="arm_free", spans={"single": (target, target)})
    assert truth.lam == pytest.approx(target, rel=0.3)
    assert 0 <= truth.kappa <= 1


def test_what_the_unknowns_can_do_is_fully_concealed(motions):
    """A trace along an unknown's own sensitivity is projected off, up to its prior."""
    rig, motion = RIGS["arm_free"], motions["arm_free"]
    errors, runs = np.zeros(6), np.arange(2)
    played = play(new_world(rig, errors, fine=False), motion.start[runs], motion.ctrl[runs])
    windows = cut(rig, motion, played.states, runs)
    sizes = gather(windows, played.samples).reshape(len(windows.row), -1) / rig.sd.mean()
    assert sizes.shape == predict(rig, models(rig, errors), windows.start, windows.ctrl).shape
    tangent = tangents(rig, errors, windows, pushed=False)
    seen = visibility_of(rig, tangent, whitener(np.zeros((*sizes.shape, 1))), tangent.unknown[:, :, :1])
    assert seen.concealment[0][0] > 0.999
    assert seen.size[0] <= rig.unknowns[0].sd ** -2 * 1.01


def test_nothing_is_planted_in_a_null():
    recording, truth = draw_case(0, "null", seed=3)
    assert (truth.planted, truth.site, truth.mode, truth.lam) == ("none", "none", "none", 0.0)
    assert len(recording.training) == 8 and len(recording.held_out) == 4


def test_two_effects_sit_in_two_places():
    _, truth = draw_case(1, "double", seed=3, system="arm_free")
    assert len(truth.effects) == 2 and len({e.site for e in truth.effects}) == 2
    assert truth.planted.count(";") == 1


def test_twins_cannot_be_told_apart():
    assert {name for twin in TWINS for name in twin.names} <= set(EFFECTS)
    _, truth = draw_case(1, "twin", seed=3, system="arm_free")
    assert truth.rival.name != truth.effects[0].name
    assert truth.left < 4 < truth.lam


def test_twins_that_no_experiment_would_split_are_not_drawn(monkeypatch):
    monkeypatch.setattr(draw, "best_split", lambda *_: 10.9)
    with pytest.raises(ValueError, match="found no fit"):
        draw_case(1, "twin", seed=3, system="arm_free")


@pytest.mark.parametrize(
    ("style", "names", "splits"),
    [("slow", ("command_delay", "actuator_lag"), False), ("oneway", ("torque_offset", "coulomb"), True)],
)
def test_an_oracle_knows_which_twins_an_experiment_splits(style, names, splits):
    """A delay and a lag of 1 ms look alike whatever the free arm does; an offset and dry friction do not, once it turns
    round."""
    rig, rng = rig_of("arm_free"), np.random.default_rng(4)
    motion = draw_motion(rig, rng, style)
    stage = set_stage(rig, motion, np.zeros(len(rig.unknowns)), motion.start, 0.07, 0.1)
    sites = [known(name).sites["arm_free"][0] for name in names]
    sizes = ({"delay": 0.001}, {"time": 0.001}) if style == "slow" else ({"offset": 0.05}, {"friction": 0.05})
    traces = [trace(stage, n, s, 1.0, v) for n, s, v in zip(names, sites, sizes, strict=True)]
    assert (best_split(stage, list(zip(names, sites, strict=True)), traces, rng) > SPLIT) == splits


def test_throws_are_split_by_other_throws():
    """Drag that grows with speed and drag that grows with its square, of a block that is always thrown as fast."""
    rig, rng = rig_of("block"), np.random.default_rng(4)
    motion = draw_motion(rig, rng, "steady")
    stage = set_stage(rig, motion, np.zeros(len(rig.unknowns)), motion.start, 0.07, 0.1)
    places = [("linear_drag", "block"), ("quadratic_drag", "block")]
    traces = [trace(stage, *place, 1.0, {"coefficient": 0.1}) for place in places]
    assert best_split(stage, places, traces, rng) > SPLIT


def test_only_experiments_that_count_are_played(monkeypatch):
    """Those of twins always, any others of the chosen cases only."""
    kinds = {"1": "twin", "2": "single", "3": "single"}

    def asked(sealed, case):
        return SimpleNamespace(
            truth=SimpleNamespace(kind=kinds[case]), play=lambda run: replace(run, measured=np.zeros((1, 1)))
        )

    monkeypatch.setattr(generator, "robot", asked)
    own = {"ctrl": np.zeros((1, 1)), "qpos": np.zeros(1), "qvel": np.zeros(1)}
    commands = {f"{case}/designed/{name}": array for case in kinds for name, array in own.items()}
    played = generator.reveal(Path(), commands, ["3"], lambda line: None)
    assert {name for name in played if name.endswith("measured")} == {"1/designed/measured", "3/designed/measured"}


def test_the_recording_says_nothing_about_the_noise_or_the_effect(case):
    recording, truth = case
    assert np.isnan(recording.noise).all()
    assert truth.effects[0].name not in recording.xml


def test_recordings_survive_the_disk(case, tmp_path):
    recordings, sealed = written(tmp_path, case)
    assert cases_in(recordings) == ["001"]
    back = load_recording(recordings, "001")
    assert (back.xml, back.channels, back.unknowns) == (case[0].xml, case[0].channels, case[0].unknowns)
    for got, run in zip(back.runs, case[0].runs, strict=True):
        assert np.array_equal(got.measured, run.measured) and np.array_equal(got.ctrl, run.ctrl)
        assert (got.name, got.held_out, got.qpos) == (run.name, run.held_out, None)
    assert open_seal(sealed, recordings, "001") == case[1]


def test_starts_of_throws_survive_the_disk(motions, tmp_path):
    recording, _ = draw_case(2, "null", seed=3, system="block")
    save_recording(tmp_path, "a", recording)
    back = load_recording(tmp_path, "a")
    assert np.array_equal(back.runs[3].qvel, recording.runs[3].qvel)
    assert np.array_equal(back.start_sd, recording.start_sd) and back.window == recording.window


def test_a_recording_of_a_simulation_that_is_unstable_is_drawn_again(monkeypatch):
    """What one integrator reads far more of than another is no physics, and nobody could diagnose it."""
    real = draw.record

    def shaken(truth, motion):
        recording = real(truth, motion)
        return replace(recording, runs=tuple(replace(run, measured=100 * run.measured) for run in recording.runs))

    monkeypatch.setattr(draw, "ATTEMPTS", {"null": 1})
    draw_case(2, "null", seed=3, system="block")
    monkeypatch.setattr(draw, "record", shaken)
    with pytest.raises(ValueError, match="found no fit in 1 draws"):
        draw_case(2, "null", seed=3, system="block")


def test_recordings_can_be_read_without_the_seals(case, tmp_path):
    recordings, sealed = written(tmp_path, case)
    (sealed / "001" / "truth.json").unlink()
    assert load_recording(recordings, "001").runs
    with pytest.raises(ValueError, match=r"case 001 has no .*truth\.json"):
        open_seal(sealed, recordings, "001")


def test_a_broken_seal_is_noticed(case, tmp_path):
    recordings, sealed = written(tmp_path, case)
    path = sealed / "001" / "truth.json"
    path.write_text(path.read_text().replace(case[1].effects[0].site, "joint_9"))
    with pytest.raises(ValueError, match="the seal of case 001 is broken"):
        open_seal(sealed, recordings, "001")


def test_a_pickled_recording_is_refused(tmp_path):
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "model.xml").write_text("<mujoco/>")
    np.savez(tmp_path / "x" / "recording.npz", about=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match=r"recording\.npz is damaged"):
        load_recording(tmp_path, "x")


def test_a_missing_case_is_named(tmp_path):
    with pytest.raises(ValueError, match="no recording of case '7'"):
        load_recording(tmp_path, "7")


def test_truths_survive_json(case):
    assert from_json(json.loads(json.dumps(as_json(case[1])))) == case[1]


def test_the_robot_repeats_its_motion_with_fresh_noise(case, tmp_path):
    recording, truth = case
    _, sealed = written(tmp_path, case)
    run = recording.runs[0]
    start = np.array(truth.start[:1])
    (again,) = run_on_robot(truth, run.ctrl[None], start, ("again",))
    apart = (again.measured - run.measured)[:20] / np.array(truth.noise)
    assert 0.5 < np.abs(apart).mean() < 30
    told = type(run)("designed", run.ctrl, np.empty((0, 0)), False, start[0, :3], start[0, 3:])
    assert robot(sealed, "001").play(told).measured == pytest.approx(again.measured)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [((0, "many"), "no kind is called 'many'"), ((0, "single", 0, "crane"), "no rig is called 'crane'")],
)
def test_bad_requests_get_one_line(arguments, words):
    with pytest.raises(ValueError, match=words):
        draw_case(*arguments)


def test_unknown_names_are_listed():
    with pytest.raises(ValueError, match="nothing called 'ghost' can be planted; there are coulomb"):
        known("ghost")
    with pytest.raises(ValueError, match="there are arm_free"):
        rig_of("crane")
