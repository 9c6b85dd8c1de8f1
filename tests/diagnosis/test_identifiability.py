"""What motions cannot show is known by hand on rigs so small: still joints, one speed, one direction, no gravity."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from fimpact.diagnosis.identifiability.blind_spots import not_shown
from fimpact.diagnosis.identifiability.case_check import shown_by_motions
from fimpact.diagnosis.identifiability.judging import Asked, Judge
from fimpact.diagnosis.identifiability.proposed_motions import Advisor
from fimpact.diagnosis.identifiability.quick_look import Sight, look
from fimpact.diagnosis.identifiability.sentences import UNSEEN, findings_to_tell
from fimpact.effects import EFFECTS
from fimpact.recordings import Recording, Run, Unknown
from fimpact.selection.regression import Regression
from fimpact.smoothing.candidates import candidates
from fimpact.smoothing.columns import columns, motion_scales
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

PERIOD, NOISE = 0.01, 1e-4
LINK = """<body name="{body}" pos="{pos}"><joint name="{joint}" axis="{axis}" damping="0.02"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5" contype="0" conaffinity="0"/>{more}</body>"""


def xml(axis: str = "0 1 0", joints: Sequence[str] = ("shoulder", "wrist"), gravity: str = "0 0 -9.81") -> str:
    """A chain of links under motors, each joint measured."""
    chain = ""
    for k, joint in reversed(list(enumerate(joints))):
        chain = LINK.format(body=f"{joint}_link", joint=joint, axis=axis, pos="0.3 0 0" if k else "0 0 0", more=chain)
    motors = "".join(f'<motor name="{j}_motor" joint="{j}"/>' for j in joints)
    reads = "".join(f'<jointpos name="{j}" joint="{j}"/>' for j in joints)
    return (
        f'<mujoco><option timestep="0.005" gravity="{gravity}"/><worldbody>{chain}</worldbody>'
        f"<actuator>{motors}</actuator><sensor>{reads}</sensor></mujoco>"
    )


def moved(text: str, way: Callable[[np.ndarray], np.ndarray], unknowns: Sequence[Unknown] = (), back=False):
    """The rig's joints (T, nq) along `way` of the time, under the torques that takes, with 2 % that nobody knows;
    back: in a second run the other way. The last run is held out."""
    model, rng, runs = mujoco.MjModel.from_xml_string(text), np.random.default_rng(0), []
    time = np.arange(800) * PERIOD
    for k, sign in enumerate((1, -1, 1) if back else (1, 1)):
        qpos, data = sign * way(time + 0.3 * k), mujoco.MjData(model)
        qvel = np.gradient(qpos, PERIOD, axis=0)
        qacc, ctrl = np.gradient(qvel, PERIOD, axis=0), np.empty((len(time), model.nu))
        for row, out in enumerate(ctrl):
            data.qpos[:], data.qvel[:], data.qacc[:] = qpos[row], qvel[row], qacc[row]
            mujoco.mj_inverse(model, data)
            out[:] = data.qfrc_inverse
        ctrl += 0.02 * (ctrl.std(0) + 1e-3) * rng.standard_normal(ctrl.shape)
        runs.append(Run(f"run_{k}", ctrl, qpos + NOISE * rng.standard_normal(qpos.shape), False))
    runs[-1] = replace(runs[-1], held_out=True)
    names, free = tuple(model.joint(i).name for i in range(model.njnt)), np.full(2 * model.nv, np.inf)
    noise = np.full(len(names), NOISE)
    return Recording(text, ".", PERIOD, names, tuple(runs), tuple(unknowns), noise, free, 0.5)


def swing(*rates: float) -> Callable[[np.ndarray], np.ndarray]:
    """Sums of two sines of each joint, far from one speed; a rate of 0 keeps a joint where it is."""
    return lambda t: np.stack([0.4 * np.sin(r * t) + 0.2 * np.sin(2.3 * r * t + 1) for r in rates], 1) + 0.3


def turning(time: np.ndarray) -> np.ndarray:
    """1 rad/s, for ever."""
    return time[:, None]


def seen(recording: Recording) -> Sight:
    sight = look(recording)
    assert isinstance(sight, Sight), sight
    return sight


def alike(sight: Sight) -> list[set[str]]:
    return [set(group) for group in sight.judge.judged().alike]


def together(sight: Sight, *names: str) -> bool:
    return any(set(names) <= group for group in alike(sight))


def test_a_rich_motion_shows_friction_and_inertia():
    found = seen(moved(xml(), swing(2.0, 3.1))).judge.judged()
    assert not {n for n in found.unseen if n.startswith(("coulomb", "viscous", "rotor", "payload"))}
    assert not [group for group in found.alike if any(name.startswith(("coulomb", "viscous")) for name in group)]


def test_a_joint_that_never_moves_shows_no_friction_and_is_to_be_moved_alone():
    sight = seen(moved(xml("0 0 1"), swing(2.0, 0.0)))
    unseen = sight.judge.judged().unseen
    assert {"coulomb@wrist", "viscous@wrist"} <= set(unseen)
    assert not {"coulomb@shoulder", "viscous@shoulder"} & set(unseen)
    line = next(
        one for one in findings_to_tell(sight.judge.judged(), sight.judge.asked, sight) if "coulomb@wrist" in one.names
    )
    assert "wrist (it never moves)" in line.what
    assert line.motion.startswith("Move wrist alone, there and back")


@pytest.mark.parametrize("back", [True, False])
def test_at_one_speed_dry_and_viscous_friction_are_one(back):
    sight = seen(moved(xml("0 0 1", ["wheel"]), turning, back=back))
    assert together(sight, "coulomb@wheel", "viscous@wheel")
    posing = ("torque_offset@wheel_motor", "coulomb@wheel")
    assert (posing in sight.judge.judged().posing) == (not back)
    lines = [f"{one.what}: {one.motion}" for one in findings_to_tell(sight.judge.judged(), sight.judge.asked, sight)]
    posed = [line for line in lines if line.startswith("torque offset at wheel_motor from Coulomb friction at wheel")]
    assert bool(posed) == (not back)
    assert all("Move wheel alone, there and back" in line for line in posed)


def test_two_speeds_tell_dry_from_viscous_friction():
    sight = seen(moved(xml("0 0 1", ["wheel"]), turning, back=True))
    names = ["coulomb@wheel", "viscous@wheel"]
    advice, groups = Advisor(sight, names).parts(names)
    assert len(groups) == 2
    assert advice.joint == "wheel"
    assert advice.how.startswith("there and back")


def test_without_gravity_mass_and_inertia_of_one_joint_are_one():
    free = [Unknown("mass", "arm_link", 0.5), Unknown("inertia", "arm_link", 0.5)]
    flat = seen(moved(xml("0 0 1", ["arm"]), swing(2.0), free))
    assert together(flat, "mass@arm_link", "inertia@arm_link")
    assert Advisor(flat, ["mass@arm_link", "inertia@arm_link"]).parts(["mass@arm_link", "inertia@arm_link"]) is None
    upright = seen(moved(xml("0 1 0", ["arm"]), swing(4.0), free))
    assert not together(upright, "mass@arm_link", "inertia@arm_link")


def test_a_motors_gain_and_all_that_weighs_are_one():
    sight = seen(
        moved(xml("0 0 1", ["arm"]).replace('damping="0.02"', ""), swing(2.0), [Unknown("mass", "arm_link", 1)])
    )
    assert together(sight, "mass@arm_link", "gain@arm_motor")


def test_a_payload_is_more_mass():
    sight = seen(moved(xml("0 0 1", ["arm"]), swing(2.0), [Unknown("mass", "arm_link")]))
    assert together(sight, "mass@arm_link", "payload@arm_link")


def test_what_is_the_same_number_of_the_model_is_asked_once():
    sight = seen(moved(xml(), swing(2.0, 3.1), [Unknown("damping", "wrist", 0.5)]))
    names = [own.name for own in sight.judge.asked]
    assert "damping@wrist" in names
    assert "viscous@wrist" not in names
    assert "viscous@shoulder" in names


def test_a_terminal_is_told_in_a_few_lines():
    lines = shown_by_motions(moved(xml("0 0 1"), swing(2.0, 0.0)))
    assert any("never move" in line for line in lines)
    assert len(lines) <= 2 * 6 + 3
    assert all(len(line) < 200 for line in lines)


def test_what_nobody_measures_is_left_to_the_diagnosis():
    whole = moved(xml(), swing(2.0, 3.1))
    runs = tuple(Run(r.name, r.ctrl, r.measured[:, :1], r.held_out) for r in whole.runs)
    part = Recording(whole.xml, ".", PERIOD, ("shoulder",), runs, (), whole.noise[:1], whole.start_sd, 0.5)
    assert look(part) == "nothing measures where wrist is"


def test_a_diagnosis_tells_it_of_all_that_its_search_asked():
    recording = moved(xml("0 0 1"), swing(2.0, 0.0), [Unknown("inertia", "wrist_link", 0.3)])
    made = prepare(recording)
    smoothed = smooth(made.track, made.begun, made.noise)
    names = ("inertia", "coulomb", "viscous", "stribeck", "sensor_bias")
    tried = candidates([EFFECTS[name] for name in names], made.track, motion_scales(smoothed))
    found = not_shown(recording, Regression(smoothed, columns(smoothed, tried)))
    unseen = {name: one for one in found for name in one.names if one.kind == UNSEEN}
    assert "coulomb@wrist" in unseen
    assert "coulomb@shoulder" not in unseen
    assert unseen["coulomb@wrist"].motion.startswith("Move wrist alone")
    every = [name for one in found for name in one.names]
    assert not [name for name in every if name.startswith("stribeck")]
    assert every.count("inertia@wrist_link") <= 1


def judge(gram: Sequence[Sequence[float]], free: Sequence[bool]) -> Judge:
    asked = [Asked(f"{'abc'[k]}@x", own, -1 if own else 1, (k,)) for k, own in enumerate(free)]
    return Judge(np.array(gram, float), np.ones(len(free)), asked)


def test_unseen_is_what_nothing_explains_nearly_as_well():
    found = judge(np.diag([5.9, 6.1]), [False, False]).judged()
    assert set(found.unseen) == {"a@x"}


def test_alike_is_what_passes_for_the_other_both_ways():
    assert judge([[100, 99], [99, 100]], [False, False]).judged().alike == (("a@x", "b@x"),)
    assert judge([[100, 10], [10, 100]], [False, False]).judged().alike == ()
    # A part of something large passes for it only at a size that no such part has.
    found = judge([[1e4, 300], [300, 10]], [False, False]).judged()
    assert found.alike == ()
    assert found.posing == (("b@x", "a@x"),)


def test_what_is_fitted_anyway_takes_up_its_like():
    found = judge([[100, 99.9, 0], [99.9, 100, 0], [0, 0, 100]], [True, False, False]).judged()
    assert found.alike == (("a@x", "b@x"),)


def test_what_only_all_together_take_up_is_told_apart_from_pairs():
    columns = np.array([[30.0, 0, 30], [0, 30, 30]])
    found = judge(columns.T @ columns, [True, True, False]).judged()
    assert found.alike == ()
    assert found.swallowed == ("c@x",)


def test_what_servos_are_late_by_is_no_noise_and_what_they_give_no_column():
    """A lag beyond the one size that is asked is not left over as noise that hides all else; nor is nothing left, as
    where servos that give nothing move what weighs nothing."""
    text = xml("0 1 0", ["arm"]).replace("<motor", '<position kp="20" kv="1"')
    rates, phases = np.random.default_rng(1).uniform(0.5, 6, (2, 20)) * [[2], [1]]
    still = moved(text, lambda t: (0.08 * np.sin(np.outer(t, rates) + phases)).sum(1)[:, None])
    late = tuple(Run(r.name, np.roll(r.measured, -20, 0), r.measured, r.held_out) for r in still.runs)
    sight = seen(Recording(text, ".", PERIOD, ("arm",), late, (), still.noise, still.start_sd, 0.5))
    left = sight.noise[0] / np.sqrt(np.mean(sight.motion.missing**2))
    assert 1e-3 < left < 0.15


def test_readings_slower_than_the_grid_are_taken_at_their_own_pace():
    whole = moved(xml(), swing(2.0, 3.1), [Unknown("mass", "wrist_link", 0.2)])
    runs = []
    for run in whole.runs:
        measured = run.measured.copy()
        measured[1::2] = np.nan
        runs.append(Run(run.name, run.ctrl, measured, run.held_out))
    slow = seen(
        Recording(whole.xml, ".", PERIOD, whole.channels, tuple(runs), whole.unknowns, whole.noise, whole.start_sd, 0.5)
    )
    assert slow.motion.track.period == 2 * PERIOD
    assert "mass@wrist_link" not in slow.judge.judged().unseen
