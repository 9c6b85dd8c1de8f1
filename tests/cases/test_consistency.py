"""Log conventions that are never right silently: each wrong in every run or in one, its clean twin without a word."""

from collections.abc import Callable

import numpy as np
import pytest
import robots
from robots import Change

from fimpact.cases import CaseError, read_case

ROBOTS = {  # MJCF, sensors of the case, units of commands
    "two": (robots.arm(2, 2), ["q0", "q1", "v0", "v1", "gyro", "acc", "turn", "force", "torque"], {}),
    "bare": (robots.arm(7, 2), ["q0", "q1"], {}),
    "three": (robots.arm(6, 3), ["q0", "q1", "q2"], {}),
    "servo": (robots.arm(5, 2, servo=True), ["q0", "q1"], {"m0": "rad", "m1": "rad"}),
    "flyer": (robots.FLYER, ["place", "turn", "gyro", "acc"], {"lift": "N"}),
    "blind": (robots.FLYER, ["place", "acc"], {"lift": "N"}),
    "still": (robots.FLYER, ["place", "turn"], {"lift": "N"}),
}


def times(factor: float, *names: str) -> Change:
    return lambda c: {name: factor * c[name] for name in names}


def of(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Change:
    return lambda c: {name: change(c[name])}


def vector(sensor: str, change: Callable[[np.ndarray, dict], np.ndarray]) -> Change:
    """A change of all components of a sensor, (T, k)."""

    def changed(c: dict) -> dict:
        names = [name for name in c if name.startswith(f"{sensor}_")]
        return dict(zip(names, change(np.column_stack([c[n] for n in names]), c).T, strict=True))

    return changed


def exchanged(one: str, other: str) -> Change:
    return lambda c: {one: c[other], other: c[one]}


def axes(c: dict) -> np.ndarray:
    """Axes of the body (or site) that `turn` measures, in the world, (T, 3, 3)."""
    w, v = c["turn_0"][:, None, None], np.column_stack([c[f"turn_{k}"] for k in (1, 2, 3)])
    cross = np.zeros((len(v), 3, 3))
    for (i, j), k, sign in (((0, 1), 2, -1), ((0, 2), 1, 1), ((1, 2), 0, -1)):
        cross[:, i, j], cross[:, j, i] = sign * v[:, k], -sign * v[:, k]
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def in_world(values: np.ndarray, c: dict) -> np.ndarray:
    return np.einsum("tij,tj->ti", axes(c), values)


def weightless(values: np.ndarray, c: dict) -> np.ndarray:
    return values - np.einsum("tji,j->ti", axes(c), [0, 0, 9.81])


def shifted(seconds: float, *names: str) -> Change:
    return lambda c: {name: np.interp(c["t"] - seconds, c["t"], c[name]) for name in names}


GYRO = [f"gyro_{k}" for k in range(3)]
WRONG = {  # robot, change, words of the line
    "quaternion x y z w, thrown": ("still", vector("turn", lambda q, c: q[:, [1, 2, 3, 0]]), "x, y, z, w"),
    "quaternion x y z w, with a gyro": ("flyer", vector("turn", lambda q, c: q[:, [1, 2, 3, 0]]), "x, y, z, w"),
    "quaternion x y z w, on an arm": ("two", vector("turn", lambda q, c: q[:, [1, 2, 3, 0]]), "x, y, z, w"),
    "quaternion inverted, with a gyro": ("flyer", vector("turn", lambda q, c: q * [1, -1, -1, -1]), "inverted"),
    "quaternion inverted, on an arm": ("two", vector("turn", lambda q, c: q * [1, -1, -1, -1]), "inverted"),
    "gyro in the world, flying": ("flyer", vector("gyro", in_world), "axes of the world"),
    "gyro in the world, on an arm": ("two", vector("gyro", in_world), "axes of the world"),
    "gyro in degrees": ("flyer", times(180 / np.pi, *GYRO), "in degrees"),
    "gyro reversed": ("two", times(-1, *GYRO), "wrong sign"),
    "gyro with two axes exchanged": ("two", exchanged("gyro_0", "gyro_1"), "axes are exchanged"),
    "gyro too large by 1000": ("two", times(1000, *GYRO), "wrong by 1000"),
    "gyro on another clock": ("two", shifted(0.6, *GYRO), "clocks"),
    "gyro on another clock, flying": ("flyer", shifted(0.5, *GYRO), "clocks"),
    "gravity taken out, arm": ("two", vector("acc", weightless), "gravity was taken out"),
    "gravity taken out, in the world": (
        "two",
        vector("acc", lambda a, c: in_world(weightless(a, c), c)),
        "gravity was taken out and",
    ),
    "acceleration in g": ("two", times(1 / 9.80665, "acc_0", "acc_1", "acc_2"), "in g"),
    "acceleration reversed": ("two", times(-1, "acc_0", "acc_1", "acc_2"), "wrong sign"),
    "acceleration in the world": ("two", vector("acc", in_world), "axes of the world"),
    "force reversed": ("two", times(-1, "force_0", "force_1", "force_2"), "wrong sign"),
    "force in mN": ("two", times(1000, "force_0", "force_1", "force_2"), "wrong by 1000"),
    "force with two axes exchanged": ("two", exchanged("force_0", "force_2"), "axes are exchanged"),
    "torque reversed": ("two", times(-1, "torque_0", "torque_1", "torque_2"), "wrong sign"),
    "angle in degrees": ("bare", times(180 / np.pi, "q1"), "degrees"),
    "angle in degrees, three joints": ("three", times(180 / np.pi, "q0"), "degrees"),
    "angle reversed": ("three", times(-1, "q1"), "wrong sign"),
    "angles exchanged": ("three", exchanged("q0", "q2"), "swapped"),
    "angle normalised to -100..100": ("bare", of("q0", lambda q: q / np.deg2rad(170) * 100), "-100..100"),
    "angle in counts": ("bare", of("q0", lambda q: np.round(q / (2 * np.pi / 4096) + 2048)), "counts"),
    "speed in degrees": ("two", times(180 / np.pi, "v1"), "degrees"),
    "speed reversed": ("two", times(-1, "v0"), "wrong sign"),
    "speeds exchanged": ("two", exchanged("v0", "v1"), "swapped"),
    "speed without a sign": ("two", of("v0", np.abs), "no sign"),
    "speed on another clock": ("two", shifted(-0.7, "v0", "v1"), "clocks"),
    "command reversed": ("bare", times(-1, "u_m1"), "wrong sign"),
    "command too small by 1000": ("three", times(1e-3, "u_m0"), "wrong by 1000"),
    "commands exchanged": ("three", exchanged("u_m0", "u_m1"), "swapped"),
    "torque without direction": ("bare", of("u_m0", np.abs), "no direction"),
    "current as unsigned 16 bits": ("bare", of("u_m0", lambda u: np.round(1000 * u) % 65536), "65536"),
    "effort never filled": ("bare", of("u_m1", lambda u: 0 * u + 6.9e-310), "never filled"),
    "servo told in degrees": ("servo", times(180 / np.pi, "u_m0"), "degrees"),
    "servo read in degrees": ("servo", times(180 / np.pi, "q1"), "degrees"),
    "servo reversed": ("servo", times(-1, "u_m1"), "wrong sign"),
    "servos exchanged": ("servo", exchanged("u_m0", "u_m1"), "swapped"),
    "target and angle exchanged": (
        "servo",
        lambda c: {"u_m0": c["q0"], "q0": c["u_m0"], "u_m1": c["q1"], "q1": c["u_m1"]},
        "exchanged",
    ),
    "target taken for the angle": ("servo", lambda c: {"q0": c["u_m0"]}, "same numbers"),
    "commands on another clock": ("servo", shifted(1.0, "u_m0", "u_m1"), "clock"),
}
WRONG |= {
    f"gravity taken out, {what}": ("blind", change, "gravity was taken out, or it is in g")
    for what, change in {
        "nothing else known": vector("acc", lambda a, c: a - [0, 0, 9.81]),
        "acceleration in g": times(1 / 9.80665, "acc_0", "acc_1", "acc_2"),
    }.items()
}
WRONG_ONCE = {
    "angle always zero": ("bare", of("q1", lambda q: 0 * q), "does not change in run 'b'"),
    "gyro always zero": ("two", times(0, *GYRO), "does not change in run 'b'"),
    "effort never filled": ("bare", times(0, "u_m0"), "is 0 throughout run 'b'"),
    "effort of memory": ("bare", of("u_m0", lambda u: 0 * u + 4.9e-324), "never filled"),
}
ONE = ["gyro in degrees", "speed reversed", "angle in degrees", "angle reversed", "command reversed", "servo reversed"]
ONE += ["gravity taken out, arm", "quaternion x y z w, thrown", "servo read in degrees", "force reversed"]


def refusal(tmp_path, robot: str, changes: dict[str, Change], **keys) -> str:
    """The line with which a case ends, or ""."""
    xml, used, units = ROBOTS[robot]
    path = robots.write(tmp_path, xml, used, units, changes, **keys)
    try:
        read_case(path)
    except CaseError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_clean_log_is_silent(robot, tmp_path):
    assert not refusal(tmp_path, robot, {})


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_in_every_run_is_said(name, tmp_path):
    robot, change, words = WRONG[name]
    line = refusal(tmp_path, robot, {"a": change, "b": change})
    assert words in line and "only" not in line


@pytest.mark.parametrize("name", WRONG_ONCE)
def test_what_is_dead_in_one_run_is_said(name, tmp_path):
    robot, change, words = WRONG_ONCE[name]
    assert words in refusal(tmp_path, robot, {"b": change})


@pytest.mark.parametrize("name", ONE)
def test_what_is_wrong_in_one_run_is_said_of_that_run(name, tmp_path):
    robot, change, words = WRONG[name]
    line = refusal(tmp_path, robot, {"b": change})
    assert words in line and "'b'" in line


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("servo", [False, True])
def test_an_honest_model_error_is_no_wrong_convention(seed, servo, tmp_path):
    joints = 1 + seed
    used = [f"q{i}" for i in range(joints)] + ["gyro", "acc", "turn", "force", "torque"][: seed + 2]
    units = {f"m{i}": "rad" for i in range(joints)} if servo else {}
    # Masses 10 to 30 % off, friction that the model lacks, and 20 ms from a command to its torque.
    path = robots.write(tmp_path, robots.arm(40 + seed, joints, servo), used, units, {}, wrong=True, late=2)
    assert read_case(path).runs


def test_a_joint_that_hardly_moves_decides_nothing(tmp_path):
    xml, used = robots.arm(10, 3, servo=True), ["q0", "q1", "q2"]
    assert read_case(robots.write(tmp_path, xml, used, {f"m{i}": "rad" for i in range(3)}, {})).runs


def test_a_late_sensor_is_said_and_read(tmp_path):
    xml, used, units = ROBOTS["two"]
    late = shifted(0.04, *GYRO)
    notes = read_case(robots.write(tmp_path, xml, used, units, {"a": late, "b": late})).notes
    assert len(notes) == 1 and "'gyro'" in notes[0] and "0.04 s later" in notes[0]


def test_values_that_stand_for_several_rows_count_once(tmp_path):
    xml, used, units = ROBOTS["bare"]

    def stale(c: dict) -> dict:
        return {name: np.repeat(c[name][::3], 3)[: len(c[name])] for name in used}

    recording = read_case(robots.write(tmp_path, xml, used, units, {"a": stale, "b": stale}))
    assert recording.period == pytest.approx(0.01) and "'q0' stands for 3 rows" in recording.notes[0]
    read, fresh = recording.runs[0].measured[:, 0], robots.log(xml, 1)["q0"]
    np.testing.assert_allclose(read[::3], fresh[::3], atol=1e-9)
    assert np.isnan(read).sum() == len(read) - len(read[::3])


def test_a_coarse_encoder_is_no_slow_one(tmp_path):
    xml, used, units = ROBOTS["bare"]
    coarse = of("q0", lambda q: np.round(q / 0.006) * 0.006)
    recording = read_case(robots.write(tmp_path, xml, used, units, {"a": coarse, "b": coarse}))
    assert recording.period == pytest.approx(0.01) and not recording.notes


def of_a_bag(c: dict) -> dict:
    """Rows as a bag holds them: neighbours swapped, some twice."""
    rows = np.arange(len(c["t"]))
    rows[40:700:60], rows[41:701:60] = rows[41:701:60], rows[40:700:60].copy()
    rows = np.insert(rows, [100, 300], rows[[100, 300]])
    return {name: values[rows] for name, values in c.items()}


def test_rows_of_a_bag_are_sorted_where_that_is_asked(tmp_path):
    xml, used, units = ROBOTS["bare"]
    clean = read_case(robots.write(tmp_path, xml, used, units, {}))
    changes = {"a": of_a_bag, "b": of_a_bag}
    assert "write `sort: true` under `time`" in refusal(tmp_path, "bare", changes)
    asked = {"time": {"column": "t", "unit": "s", "sort": True}}
    got = read_case(robots.write(tmp_path, xml, used, units, changes, **asked))
    for one, other in zip(got.runs, clean.runs, strict=True):
        np.testing.assert_array_equal(one.measured, other.measured)
        np.testing.assert_array_equal(one.ctrl, other.ctrl)


def test_two_rows_of_one_time_that_differ_are_not_sorted_away(tmp_path):
    def doubled(c: dict) -> dict:
        return of_a_bag(c) | {"q0": of_a_bag(c)["q0"] + 1e-3 * np.arange(len(of_a_bag(c)["t"]))}

    asked = {"time": {"column": "t", "unit": "s", "sort": True}}
    assert "are both of" in refusal(tmp_path, "bare", {"a": doubled}, **asked)


def test_a_share_of_the_range_asks_for_what_a_percent_is(tmp_path):
    percent = of("q0", lambda q: q / np.deg2rad(170) * 100)
    entry = {"q0": {"column": "q0", "unit": "percent"}, "q1": {"column": "q1", "unit": "rad"}}
    changes = {"a": percent, "b": percent}
    assert "gain: 0.0157 rad/percent" in refusal(tmp_path, "bare", changes, measurements=entry)
    entry["q0"]["gain"] = f"{np.deg2rad(1.7)} rad/percent"
    assert not refusal(tmp_path, "bare", changes, measurements=entry)
