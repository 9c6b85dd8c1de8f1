"""Rigs like the robots that people have, crowds, and how answers about them are graded."""

import json

import mujoco
import numpy as np
import pandas as pd
import pytest
from concealed_cases import cases

from fimpact.benchmark.comparators.entered_tools import enter
from fimpact.benchmark.drawing.campaigns import FOOT, SHIN
from fimpact.benchmark.drawing.draw_case import draw_case
from fimpact.benchmark.drawing.motions import draw_motion
from fimpact.benchmark.grading.answers import gather_entered, grade, listed, names_of, planted_name
from fimpact.benchmark.grading.strata import strata
from fimpact.benchmark.jsonl import as_lines
from fimpact.benchmark.plan import compared, entered, plan
from fimpact.benchmark.planting.crowd import FIELDS, TYPICAL, bare, draw_members, filled
from fimpact.benchmark.planting.ground_truth import new_world, play
from fimpact.benchmark.planting.out_of_catalogue import STRANGERS, plant
from fimpact.benchmark.rigs.registry import RIGS, rig_of
from fimpact.benchmark.seal import open_seal
from fimpact.benchmark.truth import Planted, as_json, from_json, logged
from fimpact.cli import main
from fimpact.effects import EFFECTS


@pytest.fixture(scope="module")
def crowd():
    """A crowd in the free arm, and its truth."""
    return draw_case(1, "crowd", seed=11, system="arm_free")


def still(system: str, target: float, heavy: bool = False, **planted) -> np.ndarray:
    """Positions (T, nv) of a rig whose servos are told to hold still, `target` rad away from where it is."""
    rig = rig_of(system)
    world = new_world(rig, np.zeros(len(rig.unknowns)), fine=True)
    if not heavy:
        world.spec.option.gravity = np.zeros(3)
    for place, values in planted.items():
        name, _, site = place.partition("__")
        plant(world, name, site, values)
    nv, nu = rig.naive.nv, rig.naive.nu
    return play(world, np.zeros((1, 2 * nv)), np.full((1, 20, nu), target)).states[0, :, :nv]


@pytest.mark.parametrize("system", TYPICAL)
def test_a_bare_robot_has_neither_friction_nor_rotors(system):
    rig = rig_of(system)
    naive, full = bare(rig), filled(bare(rig), draw_members(rig, np.random.default_rng(0)))
    dofs = [naive.naive.joint(name).dofadr[0] for name in rig.driven]
    assert rig.driven and not {u.field for u in naive.unknowns} & set(FIELDS.values())
    for field in ("dof_frictionloss", "dof_damping", "dof_armature"):
        assert not getattr(naive.naive, field)[dofs].any() and getattr(full.naive, field)[dofs].all()
    np.testing.assert_allclose(naive.naive.body_mass, rig.naive.body_mass)


def test_a_crowd_lacks_three_things_at_every_joint_and_one_odd_one(crowd):
    recording, truth = crowd
    model = mujoco.MjModel.from_xml_string(recording.xml)
    assert not model.dof_damping.any() and not model.dof_armature.any()
    own = {f"{e.name}@{e.site}" for e in truth.effects[:-1]}
    assert own == {f"{name}@joint_{i}" for name in FIELDS for i in (1, 2, 3)}
    assert truth.effects[-1].name not in FIELDS and truth.effects[-1].worth > 0.02
    assert min(e.lam for e in truth.effects) > 0
    assert from_json(json.loads(json.dumps(as_json(truth)))) == truth


def test_friction_that_falls_with_speed_stands_in_the_place_of_friction_that_does_not():
    _, truth = draw_case(0, "crowd", seed=11, system="arm_free")
    odd = truth.effects[-1]
    assert odd.name == "stribeck" and f"coulomb@{odd.site}" not in planted_name(truth.effects)
    assert odd.values["coulomb"] > 0.02


def test_currents_tell_the_torque_with_noise():
    rig = rig_of("six_axis")
    _, truth = draw_case(0, "null", seed=3, system="six_axis")
    ctrl, states = np.zeros((2, 200, 6)), np.random.default_rng(0).uniform(-1, 1, (2, 200, 12))
    told = logged(truth, ctrl, states, 0)
    assert told.std((0, 1)) == pytest.approx(rig.current * np.sqrt(1.5), rel=0.15)
    _, other = draw_case(0, "null", seed=3, system="leg")
    assert logged(other, ctrl[:, :, :2], states, 0) is not told
    assert not logged(other, ctrl[:, :, :2], states, 0).any()


def test_dry_friction_holds_a_servo_at_rest():
    free = still("six_servo", 0.02)
    stuck = still("six_servo", 0.02, **{f"coulomb__joint_{i}": {"friction": 0.5} for i in range(1, 7)})
    assert np.abs(free[-1]).min() > 5e-3
    assert np.abs(stuck).max() < 1e-5


@pytest.mark.parametrize("late", ["command_delay", "actuator_lag"])
def test_a_late_servo_holds_its_first_target(late):
    value = {"command_delay": {"delay": 0.03}, "actuator_lag": {"time": 0.03}}[late]
    np.testing.assert_allclose(still("six_servo", 0.02, **{f"{late}__motor_1": value}), still("six_servo", 0.02))


def test_a_base_that_gives_begins_where_it_holds_the_arm():
    soft = still("six_servo", 0.0, True, base_gives_way__base={"compliance": 0.01})
    apart = np.abs(soft - still("six_servo", 0.0, True))[:4].max()
    assert 1e-4 < apart < 8e-4  # 1e-3 where it falls first


@pytest.mark.parametrize("system", ["six_axis", "six_servo", "leg"])
def test_a_centre_of_mass_is_off_by_what_the_case_declares(system):
    """An `Unknown` is relative where the model's own value is not zero; misjudged by millimetres is what is meant."""
    rig = rig_of(system)
    for i, unknown in enumerate(rig.unknowns):
        if unknown.field.startswith("com"):
            off = new_world(rig, unknown.sd * np.eye(len(rig.unknowns))[i], fine=False).spec.compile()
            moved = np.abs(off.body(unknown.site).ipos - rig.naive.body(unknown.site).ipos).sum()
            own = rig.naive.body(unknown.site).ipos["xyz".index(unknown.field[-1])]
            assert moved == pytest.approx(0.005) == pytest.approx(unknown.sd * (abs(own) or 1))


def test_other_tools_enter_every_crowd():
    settings = {"seed": 1, "cases": {"single": 6, "crowd": 4}, "rigs": ["arm_free"], "compared": 0.2}
    crowds = {case.name for case in plan(settings) if case.kind == "crowd"}
    assert len(crowds) == 4 and set(entered(settings)) == crowds | set(compared(settings))


def test_at_least_five_strangers_are_new_to_every_catalogue():
    new = {"self_heating", "cable_hysteresis", "tilted_axis", "wound_integral", "loose_tool"}
    assert new <= set(STRANGERS) and not new & set(EFFECTS)
    assert all({"six_axis", "six_servo", "leg"} & set(STRANGERS[name].sites) for name in new)


def test_the_leg_stands_hops_and_slides():
    rig = RIGS["leg"]
    motion = draw_motion(rig, np.random.default_rng(5))
    played = play(new_world(rig, np.zeros(len(rig.unknowns)), fine=False), motion.start[:3], motion.ctrl[:3])
    rail, hip, knee = (played.states[:, :, dof] for dof in range(3))
    height = rail - SHIN * (np.cos(hip) + np.cos(hip + knee)) - FOOT
    flight = (height > 0.002).mean(1)
    assert flight[0] < 0.1 < flight[1]
    along = SHIN * (np.sin(hip) + np.sin(hip + knee))
    assert np.ptp(along[2][height[2] < 0.0]) > 0.05


def test_a_perfect_answer_to_a_crowd(crowd):
    truth = crowd[1]
    got = grade(truth, names_of(planted_name(truth.effects)), {"coulomb@joint_1": truth.effects[0].values["friction"]})
    assert got == {"precision": 1.0, "recall": 1.0, "odd_named": True, "sizes_right": 1.0}


def test_an_answer_with_a_mistake_and_a_gap(crowd):
    truth = crowd[1]
    names = [f"{e.name}@{e.site}" for e in truth.effects[:-1]]
    got = grade(truth, [*names[1:], "spring@joint_1"], {names[1]: 10.0})
    assert got["precision"] == pytest.approx(8 / 9) and got["recall"] == pytest.approx(8 / 10)
    assert not got["odd_named"] and got["sizes_right"] == 0.0


def test_what_an_oracle_does_not_tell_from_zero_is_not_asked_for(crowd):
    truth = crowd[1]
    faint = Planted("viscous", "joint_9", {"damping": 1e-9}, 1.0, 0.0, 0.0, "any")
    more = type(truth)(**{**vars(truth), "effects": (faint, *truth.effects)})
    assert grade(more, names_of(planted_name(truth.effects)), {})["recall"] == 1.0


def test_a_special_case_is_no_mistake_and_not_the_odd_effect():
    _, truth = draw_case(0, "crowd", seed=11, system="arm_free")
    dry = f"coulomb@{truth.effects[-1].site}"
    got = grade(truth, [dry], {})
    assert got["precision"] == 1.0 and not got["odd_named"] and got["recall"] == 0.0


def test_lists_are_joined_by_semicolons():
    assert listed("viscous@b+coulomb@a") == "coulomb@a;viscous@b"
    assert names_of("none") == [] and names_of("unnamed") == []


def test_least_squares_names_most_of_a_crowd(crowd):
    recording, truth = crowd
    got = enter(recording, "least squares, all terms")
    assert grade(truth, names_of(got["answer"]), got["sizes"])["recall"] > 0.6
    assert got["heldout_after"] > 0 and got["seconds"] > 0


def test_entries_become_the_published_table(tmp_path):
    row = {"case": "1: a", "of": "1", "tool": "a", "answer": "none", "precision": None, "recall": 0.0, "more": 1}
    (tmp_path / "x.jsonl").write_text(as_lines([row]))
    table = gather_entered([tmp_path / "x.jsonl"])
    assert list(table) == ["tool", "case", "answer", "precision", "recall", "heldout_after", "seconds"]
    assert table.case.tolist() == ["1"]


@pytest.fixture(scope="module")
def challenge(tmp_path_factory):
    folder = tmp_path_factory.mktemp("challenge") / "made"
    assert main(["benchmark", "make", "--seed", "5", "--out", str(folder), "--cases", "2", "--rigs", "arm_free"]) == 0
    return folder


def test_a_challenge_is_made_and_graded(challenge):
    table = pd.read_csv(challenge / "answers.csv", dtype=str, keep_default_na=False)
    assert table.case.tolist() == ["1", "2"]
    truths = [open_seal(challenge / "sealed", challenge / "recordings", case) for case in table.case]
    table["answer"], table["tool"] = [planted_name(t.effects) for t in truths], "cheat"
    table.to_csv(challenge / "right.csv", index=False)
    assert main(["benchmark", "grade", str(challenge / "right.csv")]) == 0
    entered = pd.read_csv(challenge / "entered.csv")
    assert (entered.precision == 1).all() and (entered.recall == 1).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tool,case\na,1\n", "has no column 'answer'"),
        ("tool,case,answer\na,7,none\n", "answers case '7'"),
        ("tool,case,answer\na,1,none\na,1,none\n", "answers case '1' twice"),
    ],
)
def test_a_mistake_in_answers_gets_one_line(challenge, capsys, text, words):
    (challenge / "bad.csv").write_text(text)
    assert main(["benchmark", "grade", str(challenge / "bad.csv")]) == 2
    assert words in capsys.readouterr().err


def test_a_challenge_of_an_unknown_rig_is_refused(tmp_path, capsys):
    assert main(["benchmark", "make", "--seed", "1", "--out", str(tmp_path / "x"), "--rigs", "crane"]) == 2
    assert "no rig is called 'crane'" in capsys.readouterr().err and not (tmp_path / "x").exists()


def test_strata_count_what_is_certain():
    table = cases({"single": 60, "null": 20})
    found = strata(table)
    whole = found[(found[["rig", "kind", "lambda", "concealment"]] == "all").all(axis=1)].iloc[0]
    alone = ~table.answer_set.str.contains("|", regex=False)
    sure = table[alone & (table.answer != "unnamed")]
    assert (whole.cases, whole.certain, whole.right) == (80, len(sure), sure.right.sum())
    assert (
        found[(found.rig != "all") & (found[["kind", "lambda", "concealment"]] == "all").all(axis=1)].cases.sum() == 80
    )
