"""Diagnose real, simulated and field cases, and hold what is said against the bars that were set for it.

python benchmarks/acceptance.py --shared ../shared [--rigs DIR] [--out DIR] [--only emps,gen3] [--limit 600] [--reuse]

Each diagnosis is one call of `fimpact diagnose`; only its `diagnosis.json` is read. `--rigs` is a folder that
`benchmarks/rigs/make.py` wrote; without it, seed 1 is made in OUT. `--compared DIR` has a CSV per case of what others
reach (`results/recordings/compared`). `--reuse` reads diagnoses that OUT has. A group that fails does not stop the
others. Ends with exit code 1 where a bar is missed.
"""

import argparse
import ast
import dataclasses
import json
import math
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from fimpact.cases import read_case
from fimpact.effects import EFFECTS

ROOT = Path(__file__).resolve().parents[1]
CASES = ROOT / "config" / "recordings"
PUBLISHED = {
    "emps": {"mass": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "left": 0.060},
    "cube_tosses": {"friction": (0.15, 0.25)},
    "double_pendulum": {"left": (0.26, 0.18)},
    "gen3": {"left": 0.35, "joints": 7},
}
RIGS = ("emps", "arm_pendulum", "arm_pendulum_frictionless", "double_pendulum", "cube_tosses", "gen3")
LIGHT = ("ball_drops", "ball_drops_tennis", "ball_drops_basketball")
HEAVY = ("ball_drops_bowling", "ball_drops_baseball")
SECONDS = {"gen3": 60, "cube_tosses": 300} | dict.fromkeys(LIGHT + HEAVY, 10)  # of a diagnosis on two cores; else 30
SIMULATED_SECONDS = {"servo_arm": 120, "hopping_leg": 120, "hopping_leg_coulomb": 120}
DRY = ("coulomb", "direction_dependent_coulomb", "stribeck", "dahl")
DRAG = ("linear_drag", "quadratic_drag")
STATED = ("certain", "small")  # tiers whose values are stated
WORDS = 40  # in a sentence
TOSSES = ["toss_*[0268]", "toss_*[1357]"]  # halves of the training tosses, none of those that are held out
PACKAGES = ("smoothing", "selection", "simulation", "diagnosis")


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    what: str
    bar: str
    measured: str
    passed: bool


class Unanswered(Exception):
    """A diagnosis that did not come."""


@dataclass(frozen=True)
class Bench:
    """Where things are, and how a case is diagnosed.

    limit: s that one diagnosis may take. reuse: read those that `out` has. done: names of those
    of this session, with why there is none.
    """

    shared: Path
    rigs: Path
    out: Path
    compared: Path | None
    limit: float
    reuse: bool
    done: dict[str, str] = dataclasses.field(default_factory=dict)

    def rig(self, name: str) -> dict:
        """Diagnosis of a case of config/recordings."""
        return self.diagnose(CASES / f"{name}.yaml", name, self.shared / "recordings")

    def simulated(self, name: str) -> tuple[dict, dict]:
        """Diagnosis of a generated case, and its truth."""
        folder = self.rigs / name
        if not folder.is_dir():
            raise Unanswered(f"{folder} does not exist; run benchmarks/rigs/make.py")
        return self.diagnose(folder / "case.yaml", f"simulated-{name}"), json.loads((folder / "truth.json").read_text())

    def field(self, number: str) -> dict:
        """Diagnosis of the field case whose name starts with `number`."""
        (folder,) = (self.shared / "field-cases").glob(f"{number}-*")
        return self.diagnose(folder / "case.yaml", f"field-{number}")

    def diagnose(self, case: Path, name: str, data: Path | None = None) -> dict:
        """What `fimpact diagnose` finds, with the `seconds` it took."""
        folder, clock = self.out / name, self.out / f"{name}.seconds"
        ready = (folder / "diagnosis.json").is_file() and clock.is_file()
        if self.done.get(name):
            raise Unanswered(self.done[name])
        if not (ready and (self.reuse or name in self.done)):
            clock.unlink(missing_ok=True)
            clock.write_text(str(self._run(case, name, data)))
        found = json.loads((folder / "diagnosis.json").read_text(), parse_constant=_refuse)
        return found | {"seconds": float(clock.read_text())}

    def _run(self, case: Path, name: str, data: Path | None) -> float:
        """Seconds that `fimpact diagnose` takes."""
        asked = [sys.executable, "-m", "fimpact.cli", "diagnose", str(case), "--out", str(self.out / name)]
        asked += ["--data", str(data)] if data else []
        print(f"diagnosing {case}", file=sys.stderr, flush=True)
        since, why = time.perf_counter(), ""
        try:
            done = subprocess.run(asked, capture_output=True, text=True, timeout=self.limit, check=False)
            if done.returncode:
                why = (done.stderr.strip().splitlines() or ["no message"])[-1]
        except subprocess.TimeoutExpired:
            why = f"no answer within {self.limit:g} s"
        self.done[name] = why
        if why:
            raise Unanswered(why)
        return time.perf_counter() - since


def _refuse(constant: str):
    raise ValueError(f"the JSON has {constant}")


# What a diagnosis says


def names(found: dict, *tiers: str) -> list[str]:
    """effect@site of these tiers."""
    return [effect["name"] for effect in found["effects"] if effect["tier"] in (tiers or ("certain",))]


def kinds(found: dict, site: str, *tiers: str) -> set[str]:
    """Names of the effects at a place."""
    return {name.partition("@")[0] for name in names(found, *tiers) if name.partition("@")[2] == site}


def coefficient(found: dict, name: str, which: str) -> dict | None:
    """A stated value with its interval, or None."""
    for effect in found["effects"]:
        if effect["name"] == name and effect["tier"] in STATED:
            return next((one for one in effect["coefficients"] if one["name"] == which), None)
    return None


def parameter(found: dict, field: str, site: str) -> dict | None:
    """An unknown of the case with its interval, or None."""
    for row in found["parameters"]:
        if row["name"] == f"{field}@{site}" or (row["name"], row.get("of")) == (field, site):
            return row | {"value": row["after"]}
    return None


def coulomb(found: dict, joint: str) -> dict | None:
    """Level of dry friction at a joint with its interval, the mean of both directions where they differ."""
    if plain := coefficient(found, f"coulomb@{joint}", "friction"):
        return plain
    both = [coefficient(found, f"direction_dependent_coulomb@{joint}", way) for way in ("forward", "backward")]
    if not all(both):
        return coefficient(found, f"stribeck@{joint}", "coulomb")
    return {key: float(np.mean([one[key] for one in both])) for key in ("value", "low", "high")}


def offered(found: dict) -> set[str]:
    """Every effect@site in any member of the answer set."""
    return {name for member in found["answer_set"] for name in member.split("+")}


def excludes(one: dict | None, neutral: float = 0.0) -> bool:
    """Whether an interval lies on one side of a value."""
    return bool(one) and one["low"] is not None and one["high"] is not None and not one["low"] <= neutral <= one["high"]


def near(one: dict | None, truth: float, share: float) -> bool:
    """Whether a value is within a share of the truth."""
    return bool(one) and one["value"] is not None and abs(one["value"] / truth - 1) <= share


def inside(one: dict | None, truth: float) -> bool:
    """Whether an interval holds the truth."""
    return bool(one) and one["low"] is not None and one["high"] is not None and one["low"] <= truth <= one["high"]


def left(found: dict, runs: str = "") -> dict[str, float]:
    """Share of the applied force that is left at each joint, over held-out runs whose name starts with `runs`.

    Reads `missing_force_held_out`: rows of `missing_force` of each held-out run, with its name under `run`.
    """
    rows = [row for row in found.get("missing_force_held_out", []) if str(row["run"]).startswith(runs)]
    if not rows:
        raise Unanswered("diagnosis.json has no missing_force_held_out of these runs")
    table = pd.DataFrame(rows)[["joint", "left", "applied"]]
    mean = (table.set_index("joint").astype(float) ** 2).groupby("joint", sort=False).mean() ** 0.5
    return dict(mean.left / mean.applied)


def median_error(found: dict, which: str) -> float:
    """Median over the held-out runs of one error, NaN where there is none."""
    errors = [row.get(f"error_{which}") for row in found["held_out"]["runs"]]
    return float(np.median([np.nan if error is None else error for error in errors]))


def told(one: dict | None) -> str:
    """A value and its interval in a few characters."""
    if not one or one["value"] is None:
        return "–"
    span = "" if one["low"] is None else f" [{one['low']:.4g}, {one['high']:.4g}]"
    return f"{one['value']:.4g}{span}"


def percent(shares: dict[str, float]) -> str:
    """Shares in per cent."""
    return ", ".join(f"{100 * share:.1f}" for share in shares.values()) + " %"


def listed(items) -> str:
    """Names in one cell."""
    return ", ".join(items) or "nothing"


def timed(name: str, found: dict, most: float) -> Row:
    """The line of a diagnosis' time."""
    return Row(f"{name}: seconds", f"≤ {most:g}", f"{found['seconds']:.0f}", found["seconds"] <= most)


# Real rigs


def emps(bench: Bench) -> Iterator[Row]:
    """Published fit of the axis."""
    found, known = bench.rig("emps"), PUBLISHED["emps"]
    stated = {
        "mass": parameter(found, "mass", "carriage"),
        "viscous": coefficient(found, "viscous@axis", "damping"),
        "coulomb": coulomb(found, "axis"),
    }
    for name, one in stated.items():
        passed = near(one, known[name], 0.02) and inside(one, known[name])
        yield Row(f"emps: {name}", f"{known[name]:g} within 2 % and the interval", told(one), passed)
    yield timed("emps", found, 30)
    share = left(found)
    yield Row("emps: force left, held out", "≤ 6.0 %", percent(share), max(share.values()) <= known["left"])


def gen3(bench: Bench) -> Iterator[Row]:
    """The seven-axis arm."""
    found, known = bench.rig("gen3"), PUBLISHED["gen3"]
    joints = [f"joint_{i}" for i in range(1, known["joints"] + 1)]
    dry = [j for j in joints if excludes(coulomb(found, j))]
    yield Row("gen3: Coulomb friction", "at 7 joints, no interval holds 0", f"{len(dry)}", len(dry) == 7)
    viscous = [j for j in joints if excludes(coefficient(found, f"viscous@{j}", "damping"))]
    yield Row("gen3: viscous friction", "at ≥ 6 joints, no interval holds 0", f"{len(viscous)}", len(viscous) >= 6)
    yield timed("gen3", found, SECONDS["gen3"])
    share = left(found)
    yield Row("gen3: torque left, held out", "≤ 35 % at every joint", percent(share), max(share.values()) <= 0.35)


def gen3_runs(bench: Bench) -> Iterator[Row]:
    """The sweeps against the slower motion."""
    held_out = [{"file": f"gen3/validation_{i}.csv", "held_out": True} for i in (1, 2)]
    parts = {"sweeps": ("sweep_a", "sweep_b"), "quadratic": ("quadratic",)}
    sweeps, slow = (
        _with_runs(bench, "gen3", [{"file": f"gen3/{run}.csv"} for run in runs] + held_out, name)
        for name, runs in parts.items()
    )
    joints = [f"joint_{i}" for i in range(1, 8)]
    alike = [j for j in joints if _plainly(kinds(sweeps, j)) == _plainly(kinds(slow, j))]
    yield Row("gen3: sweeps and quadratic, the same kinds", "at ≥ 6 of 7 joints", f"{len(alike)}", len(alike) >= 6)
    agree = [j for j in joints if _agree(coulomb(sweeps, j), coulomb(slow, j))]
    yield Row("gen3: sweeps and quadratic, Coulomb", "agree at ≥ 5 of 7 joints", f"{len(agree)}", len(agree) >= 5)


def _plainly(found: set[str]) -> set[str]:
    """Kinds, all dry friction as one."""
    return {"dry friction" if kind in DRY else kind for kind in found}


def _agree(one: dict | None, other: dict | None) -> bool:
    """Whether two values differ by less than their joint interval."""
    if not one or not other or any(side[key] is None for side in (one, other) for key in ("low", "high")):
        return False
    widths = [(side["high"] - side["low"]) / 2 for side in (one, other)]
    return abs(one["value"] - other["value"]) <= math.hypot(*widths)


def _with_runs(bench: Bench, case: str, runs: list[dict], name: str) -> dict:
    """Diagnosis of a case with other runs."""
    path = bench.out / f"{case}-{name}.yaml"
    path.write_text(yaml.safe_dump({"extends": str(CASES / f"{case}.yaml"), "runs": runs}, sort_keys=False))
    return bench.diagnose(path, f"{case}-{name}", bench.shared / "recordings")


def double_pendulum(bench: Bench) -> Iterator[Row]:
    """The two-link arm."""
    found = bench.rig("double_pendulum")
    for joint in ("shoulder", "elbow"):
        has = kinds(found, joint, *STATED)
        passed = bool(has & set(DRY)) and "rotor_inertia" in has
        yield Row(f"double pendulum: {joint}", "Coulomb friction and rotor inertia", listed(sorted(has)), passed)
    stribeck = [coefficient(found, name, "excess") for name in names(found, *STATED) if name.startswith("stribeck@")]
    bad = [one for one in stribeck if one and one["value"] < 0]
    yield Row("double pendulum: negative Stribeck", "0", f"{len(bad)}", not bad)
    yield timed("double pendulum", found, 30)
    share, bars = left(found, "swing-up"), PUBLISHED["double_pendulum"]["left"]
    passed = all(share[joint] <= bar for joint, bar in zip(("shoulder", "elbow"), bars, strict=True))
    yield Row("double pendulum: torque left, swing-ups", "≤ 26 / 18 %", percent(share), passed)


def pendulum(bench: Bench) -> Iterator[Row]:
    """The pendulum, with the published friction and without."""
    for case in ("arm_pendulum", "arm_pendulum_frictionless"):
        found, said = bench.rig(case), case.replace("_", " ")
        certain, stated = names(found), names(found, *STATED)
        dry = [name for name in certain if name.partition("@")[0] in DRY]
        yield Row(f"{said}: dry friction", "certain", listed(certain), bool(dry))
        yield Row(f"{said}: effects", "≤ 3", listed(stated), len(stated) <= 3)
        yield timed(said, found, 30)
        worst = _decay(bench, case)
        yield Row(f"{said}: decay rate", "within 10 % at every amplitude", f"{worst:.1%} off", worst <= 0.10)


def _decay(bench: Bench, case: str) -> float:
    """Largest relative error of the rate at which the answer loses energy, by `benchmarks/decay_rate.py`."""
    script = ROOT / "benchmarks" / "decay_rate.py"
    asked = [sys.executable, str(script), str(CASES / f"{case}.yaml"), str(bench.out / case / "diagnosis.json")]
    asked += ["--data", str(bench.shared / "recordings"), "--window", "8"]
    done = subprocess.run(asked, capture_output=True, text=True, timeout=bench.limit, check=False)
    rates = re.findall(r"recorded ([-\d.e]+),.*answer ([-\d.e]+)", done.stdout)
    if done.returncode or not rates:
        raise Unanswered(f"decay_rate.py: {(done.stderr.strip().splitlines() or ['no rates'])[-1]}")
    return max(abs(float(answer) / float(recorded) - 1) for recorded, answer in rates)


def cube(bench: Bench) -> Iterator[Row]:
    """The tossed cube."""
    found, (low, high) = bench.rig("cube_tosses"), PUBLISHED["cube_tosses"]["friction"]
    friction = parameter(found, "pair_friction", "cube_table")
    passed = bool(friction) and friction["value"] is not None and low <= friction["value"] <= high
    yield Row("cube: contact friction", f"{low:g} to {high:g}", told(friction), passed)
    stated = names(found, *STATED)
    height = [n for n in stated if n == "sensor_scale@cube_pos[2]" or n.startswith("ground_height@")]
    yield Row("cube: height scale or contact height", "named", listed(stated), bool(height))
    yield Row("cube: effects", "≤ 3, none at a bound", listed(stated), len(stated) <= 3 and not at_bounds(found))
    yield timed("cube", found, SECONDS["cube_tosses"])


def balls(bench: Bench) -> Iterator[Row]:
    """The balls that fall."""
    for case in LIGHT:
        found = bench.rig(case)
        passed = any(f"{drag}@ball" in offered(found) for drag in DRAG)
        yield Row(f"{case}: drag", "named, or in the set", listed(found["answer_set"]), passed)
        certain = "linear_drag@ball" in names(found)
        air = read_case(CASES / f"{case}.yaml", bench.shared / "recordings").spec().option.density > 0
        said = ("certain" if certain else "not certain") + ("" if air else "; no air in the model")
        yield Row(
            f"{case}: linear drag, 1000 times Stokes", "not certain where air is known", said, not (certain and air)
        )
        yield timed(case, found, SECONDS[case])
    for case in HEAVY:
        found = bench.rig(case)
        yield Row(f"{case}: named", "nothing", found["answer"], found["answer"] == "none")
        yield timed(case, found, SECONDS[case])


def errors(bench: Bench) -> Iterator[Row]:
    """Held-out error of the improved model beside those of others."""
    for case in (*RIGS, *LIGHT, *HEAVY):
        try:
            found = bench.rig(case)
        except Exception as error:
            yield Row(f"{case}: held-out error", "below all others", words(error), False)
            continue
        others = {which: median_error(found, which) for which in ("naive", "freed")} | _black_box(bench, case)
        own = median_error(found, "improved")
        beaten = {which: own <= error for which, error in others.items() if np.isfinite(error)}
        said = f"{own:.3g} {found['held_out']['unit']}; " + ", ".join(f"{w} {e:.3g}" for w, e in others.items())
        yield Row(f"{case}: held-out error", "below all others", said, np.isfinite(own) and all(beaten.values()))


def _black_box(bench: Bench, case: str) -> dict[str, float]:
    """Median held-out error of the black box, where someone has made it."""
    path = bench.compared / f"{case}.csv" if bench.compared else None
    if not path or not path.is_file():
        return {}
    table = pd.read_csv(path)
    return {"black box": float(table[table.peer == "blackbox"].error.median())}


def halves(bench: Bench) -> Iterator[Row]:
    """Two halves of the training data of each rig."""
    same = {}
    for case in (*RIGS, *LIGHT, *HEAVY):
        try:
            parts = _halves(bench, case)
            certain = [_certain_part(_with_runs(bench, case, runs, f"half-{i}")) for i, runs in enumerate(parts)]
            same[case] = certain[0] == certain[1]
            said = " / ".join(listed(sorted(part)) for part in certain)
        except Exception as error:
            same[case], said = False, words(error)
        yield Row(f"{case}: certain in both halves", "the same", said, same[case])
    yield Row("halves: the same certain part", "≥ 9 of 11 cases", f"{sum(same.values())}", sum(same.values()) >= 9)


def _certain_part(found: dict) -> set[str]:
    """Certain kinds and places, all dry friction as one."""
    pairs = [name.partition("@") for name in names(found)]
    return {f"{'dry friction' if kind in DRY else kind}@{site}" for kind, _, site in pairs}


def _halves(bench: Bench, case: str) -> list[list[dict]]:
    """Runs of a case with one half of its training runs, and with the other; a single run is cut in the middle."""
    runs = _runs(CASES / f"{case}.yaml")
    training, held_out = ([run for run in runs if bool(run.get("held_out")) == flag] for flag in (False, True))
    if case == "cube_tosses":
        return [[training[0] | {"array": pattern}, *held_out] for pattern in TOSSES]
    if len(training) > 1:
        return [training[part::2] + held_out for part in (0, 1)]
    recording = read_case(CASES / f"{case}.yaml", bench.shared / "recordings")
    middle = recording.period * len(recording.training[0].measured) / 2
    return [[training[0] | {key: float(middle)}, *held_out] for key in ("stop", "start")]


def _runs(path: Path) -> list[dict]:
    table = yaml.safe_load(path.read_text(encoding="utf-8"))
    return table["runs"] if "runs" in table else _runs(path.parent / table["extends"])


# Simulated rigs


def simulated(name: str, share: float | None = None, free: float | None = None) -> Callable[[Bench], Iterator[Row]]:
    """Rows of one generated case: exactly its effects, their sizes within `share`, its masses within `free`."""

    def rows(bench: Bench) -> Iterator[Row]:
        found, truth = bench.simulated(name)
        certain, planted = set(names(found)), set(truth["effects"])
        lacking, beside = planted - certain, certain - planted
        said = f"{len(planted & certain)} of {len(planted)}; beside: {listed(sorted(beside))}"
        yield Row(f"{name}: certain", "what was planted and nothing else", said, not lacking and not beside)
        if share is not None and planted:
            off = _sizes_off(found, truth)
            within = [error for error in off.values() if error <= share]
            worst = max(off, key=off.get)
            said = f"{len(within)} of {len(off)}; worst {worst} {off[worst]:.1%}"
            yield Row(f"{name}: sizes", f"within {share:.0%}", said, len(within) == len(off))
        if free is not None:
            rest = {key: _miss(parameter(found, *key.split("@")), value) for key, value in truth["parameters"].items()}
            said = ", ".join(f"{key} {error:.1%}" for key, error in rest.items())
            yield Row(f"{name}: masses", f"within {free:.0%}", said, max(rest.values()) <= free)
        yield timed(name, found, SIMULATED_SECONDS.get(name, bench.limit))

    return rows


def _sizes_off(found: dict, truth: dict) -> dict[str, float]:
    return {
        name: max(_miss(coefficient(found, name, which), value) for which, value in values.items())
        for name, values in truth["effects"].items()
    }


def _miss(one: dict | None, truth: float) -> float:
    return abs(one["value"] / truth - 1) if one and one["value"] is not None else math.inf


def exact(name: str) -> Callable[[Bench], Iterator[Row]]:
    """Rows of one case of exact Coulomb friction: its size in the interval, nothing beside."""

    def rows(bench: Bench) -> Iterator[Row]:
        found, truth = bench.simulated(name)
        ((planted, values),) = truth["effects"].items()
        one = coefficient(found, planted, "friction")
        size = values["friction"]
        yield Row(f"{name}: size", f"{size:g} in the interval", told(one), inside(one, size))
        stated = names(found, *STATED)
        yield Row(f"{name}: stated", planted, listed(stated), stated == [planted])

    return rows


# Field cases


def field(number: str, bar: str, judge: Callable[[dict], bool]) -> Callable[[Bench], Iterator[Row]]:
    """The row of one field case, right as its expected.txt has it."""

    def rows(bench: Bench) -> Iterator[Row]:
        found = bench.field(number)
        said = f"{listed(names(found))}; set {listed(found['answer_set'])}"
        yield Row(f"field case {number}", bar, said, judge(found))

    return rows


def has(*wanted: str) -> Callable[[dict], bool]:
    """Whether one of these is in the set."""
    return lambda found: bool(offered(found) & set(wanted))


def sized(name: str, which: str, truth: float) -> Callable[[dict], bool]:
    """Whether this is certain, with the truth in its interval."""
    return lambda found: name in names(found) and inside(coefficient(found, name, which), truth)


def _inertia_of_a_box(found: dict) -> bool:
    mentioned = {"inertia@box", "rigid_body@box"} & offered(found)
    absolute = names(found) == ["inertia@box"] and len(found["answer_set"]) == 1 and not found["notes"]
    return bool(mentioned) and not absolute


def _nameless(found: dict) -> bool:
    single = len(found["answer_set"]) == 1 and found["answer"] not in ("none", "unnamed")
    return found["answer"] == "unnamed" or not single or "base_gives_way" in found["answer"]


def _stale(found: dict) -> bool:
    repeats = any("repeat" in note or "twice" in note for note in found["notes"])
    return repeats or (sized("coulomb@elbow", "friction", 0.15)(found) and "sensor_delay" not in str(names(found)))


FIELD = {
    "08": field("08", "inertia@box, its scale unknown, or a set", _inertia_of_a_box),
    "12": field("12", "load_dependent_friction@j1, or a set with it", has("load_dependent_friction@j1")),
    "13": field("13", "joint_elasticity@j1", has("joint_elasticity@j1")),
    "14": field("14", "no confident single name", _nameless),
    "16": field("16", "nothing", lambda found: found["answer"] == "none"),
    "17": field("17", "saturation@s1 = 1.1", sized("saturation@s1", "limit", 1.1)),
    "25": field(
        "25",
        "coulomb@elbow and sensor_bias@shoulder",
        lambda found: {"coulomb@elbow", "sensor_bias@shoulder"} <= set(names(found)),
    ),
}
FIELD_AIMS = {
    "01": field("01", "rotor_inertia@j1, or a set with it or inertia", has("rotor_inertia@j1", "inertia@link")),
    "03": field("03", "actuator_lag@s1, or a set with command_delay", has("actuator_lag@s1", "command_delay@s1")),
    "05": field("05", "coulomb@crank, or a set with it", has("coulomb@crank", "coulomb@rocker")),
    "11": field("11", "coulomb@elbow = 0.15, or that values repeat", _stale),
    "19": field("19", "coulomb@w = 0.012", sized("coulomb@w", "friction", 0.012)),
    "26": field("26", "coulomb@elbow = 0.15", sized("coulomb@elbow", "friction", 0.15)),
}


def every(groups: dict) -> Callable[[Bench], Iterator[Row]]:
    """Rows of several groups, each of which may fail by itself."""

    def rows(bench: Bench) -> Iterator[Row]:
        for name, group in groups.items():
            yield from attempt(name, group, bench)

    return rows


# What may be said


def at_bounds(found: dict) -> list[str]:
    """Stated values that lie at a bound of their effect which is not its neutral value."""
    out = []
    for name, one, known, neutral in _stated_values(found):
        bounds = [bound for bound in (known.low, known.high) if math.isfinite(bound) and bound != neutral]
        if any(math.isclose(one["value"], bound, rel_tol=1e-6, abs_tol=1e-12) for bound in bounds):
            out.append(f"{name}:{one['name']}")
    return out


def at_neutral(found: dict) -> list[str]:
    """Stated values whose interval holds neutral, where the value is no mere shape; or has no interval."""
    rows = _stated_values(found)
    return [f"{n}:{one['name']}" for n, one, known, neutral in rows if not known.shape and not excludes(one, neutral)]


def _stated_values(found: dict) -> Iterator[tuple]:
    for effect in found["effects"]:
        if effect["tier"] not in STATED or effect["effect"] not in EFFECTS:
            continue
        known = {one.name: one for one in EFFECTS[effect["effect"]].coefficients}
        for one in effect["coefficients"]:
            if one["value"] is not None:
                yield effect["name"], one, known[one["name"]], EFFECTS[effect["effect"]].neutral[one["name"]]


def long_sentences(found: dict) -> list[str]:
    """Sentences of the verdict with too many words."""
    sentences = re.split(r"(?<=[.!?])\s+(?=[A-Z])", found["verdict"])
    return [sentence for sentence in sentences if len(sentence.split()) > WORDS]


def values(bench: Bench) -> Iterator[Row]:
    """What all diagnoses in OUT say that may not be said."""
    files = {clock.stem: bench.out / clock.stem / "diagnosis.json" for clock in sorted(bench.out.glob("*.seconds"))}
    everything = [(name, json.loads(file.read_text(), parse_constant=_refuse)) for name, file in files.items()]
    faults = {
        "values whose interval holds neutral": at_neutral,
        "values at a bound": at_bounds,
        "values that did not converge": lambda found: [] if found["converged"] else names(found, *STATED),
        f"sentences of more than {WORDS} words": long_sentences,
    }
    for what, count in faults.items():
        bad = [f"{name}: {one}" for name, found in everything for one in count(found)]
        said = f"{len(bad)} in {len(everything)} diagnoses" + (f": {'; '.join(bad[:5])}" if bad else "")
        yield Row(what, "0", said, bool(everything) and not bad)


def size(bench: Bench) -> Iterator[Row]:
    """Deciding numbers, and lines of code."""
    tree = ast.parse((ROOT / "src" / "fimpact" / "deciding.py").read_text(encoding="utf-8"))
    numbers = [node for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign)]
    yield Row("deciding numbers", "≤ 25", f"{len(numbers)}", len(numbers) <= 25)
    files = [file for package in PACKAGES for file in (ROOT / "src" / "fimpact" / package).rglob("*.py")]
    lines = sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)
    yield Row(f"lines in {', '.join(PACKAGES)}", "≤ 5000", f"{lines}", 0 < lines <= 5000)


GROUPS: dict[str, Callable[[Bench], Iterator[Row]]] = {
    "emps": emps,
    "gen3": gen3,
    "gen3_runs": gen3_runs,
    "double_pendulum": double_pendulum,
    "pendulum": pendulum,
    "cube": cube,
    "balls": balls,
    "servo_arm": simulated("servo_arm", 0.15),
    "hopping_leg": every(
        {"hopping_leg": simulated("hopping_leg", free=0.03), "hopping_leg_coulomb": simulated("hopping_leg_coulomb")}
    ),
    "exact_coulomb": every({name: exact(name) for name in ("exact_coulomb_quiet", "exact_coulomb_noisy")}),
    "torque_arm": every({name: simulated(name, 0.15) for name in ("torque_arm", "torque_arm_viscous")}),
    "field": every({f"field case {number}": rows for number, rows in FIELD.items()}),
    "field_aims": every({f"field case {number}": rows for number, rows in FIELD_AIMS.items()}),
    "errors": errors,
    "halves": halves,
    "values": values,
    "size": size,
}


def words(error: Exception) -> str:
    """An error in one line."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if isinstance(error, Unanswered) else f"{type(error).__name__}: {text}"


def attempt(name: str, group: Callable[[Bench], Iterator[Row]], bench: Bench) -> Iterator[Row]:
    """Rows of a group; a failed one where it fails."""
    try:
        yield from group(bench)
    except Exception as error:  # one that cannot be judged must not cost the others
        yield Row(name, "judged", words(error), False)


def table(rows: list[Row]) -> str:
    """The rows in Markdown."""
    head = "| what | bar | measured | pass |\n|---|---|---|---|\n"
    cells = ([row.what, row.bar, row.measured.replace("|", "/"), "yes" if row.passed else "**no**"] for row in rows)
    return head + "\n".join(f"| {' | '.join(line)} |" for line in cells)


def main() -> int:
    """Judge what is asked for, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    parser.add_argument("--rigs", type=Path)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "acceptance")
    parser.add_argument("--compared", type=Path)
    parser.add_argument("--only", default=",".join(GROUPS))
    parser.add_argument("--limit", type=float, default=600.0, help="s that one diagnosis may take")
    parser.add_argument("--reuse", action="store_true")
    options = parser.parse_args()
    wanted = options.only.split(",")
    if unknown := set(wanted) - set(GROUPS):
        raise SystemExit(f"no group is called {', '.join(sorted(unknown))}; there are {', '.join(GROUPS)}")
    options.out.mkdir(parents=True, exist_ok=True)
    rigs = options.rigs or make_rigs(options.out / "rigs", wanted)
    made = Bench(options.shared, rigs, options.out, options.compared, options.limit, options.reuse)
    rows = []
    for name in wanted:
        for row in attempt(name, GROUPS[name], made):
            print(f"{'ok  ' if row.passed else 'MISS'} {row.what}: {row.measured}", file=sys.stderr, flush=True)
            rows.append(row)
    print(table(rows))
    print(f"\n{sum(row.passed for row in rows)} of {len(rows)} bars reached")
    return 0 if all(row.passed for row in rows) else 1


def make_rigs(folder: Path, wanted: list[str]) -> Path:
    """Cases of the simulated rigs that are wanted and not there yet."""
    simulations = {"servo_arm", "hopping_leg", "exact_coulomb", "torque_arm"} & set(wanted)
    if missing := [name for name in sorted(simulations) if not list(folder.glob(f"{name}*"))]:
        script = ROOT / "benchmarks" / "rigs" / "make.py"
        asked = [sys.executable, str(script), str(folder), "--seed", "1", "--only", ",".join(missing)]
        subprocess.run(asked, check=True, stdout=sys.stderr)
    return folder


if __name__ == "__main__":
    sys.exit(main())
