"""A case file may hold anything: what cannot be used is refused in a line that names the key."""

import pytest
from bad_input import CASE, check_refusal, state, with_, write

from fimpact.cli import main

MOTOR, ANGLE = ("commands", "drive"), ("measurements", "shoulder")
TEXT = "model: arm.xml\ntime: {column: time, unit: s}\n"
TEXT += "runs: [{file: monday.csv}, {file: tuesday.csv, held_out: true}]\n"
TEXT += "commands: {drive: {column: torque, unit: N m}}\nmeasurements: {shoulder: {column: angle, unit: rad}}\n"


def without(key: str) -> dict:
    return {name: value for name, value in CASE.items() if name != key}


BAD = [  # what is wrong, the case or its text, a word of the refusal
    ("empty", "", "table of keys"),
    ("a word", "hello", "table of keys"),
    ("a list", "- model: arm.xml", "table of keys"),
    ("a number", "3", "table of keys"),
    ("tabs", "model:\n\tx: 1", "YAML"),
    ("zeros", b"\0\0\0\0", "YAML"),
    ("not utf-8", b"model: \xff\xfe\xfa", "YAML"),
    ("picture", b"\x89PNG\r\n\x1a\n" * 9, "YAML"),
    ("runs code", "model: !!python/object/apply:os.system ['touch x']", "YAML"),
    ("brackets", "[" * 20_000, "YAML"),
    ("braces", "{a: " * 20_000, "YAML"),
    ("circle of aliases", "model: &a [*a]", "YAML"),
    ("laughs", "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
        f"{n}: &{n} [{','.join([f'*{m}'] * 9)}]\n" for m, n in zip("abcdefgh", "bcdefghi", strict=True)), "entries"),
    ("merge of a number", TEXT + "<<: 5\n", "YAML"),
    ("twice", TEXT + "model: b.xml\n", "twice"),
    ("key of null", TEXT + "null: 1\n", "is not a key"),
    ("key of a list", TEXT + "? [1, 2]\n: 3\n", "key"),
    ("two documents", TEXT + "---\n" + TEXT, "YAML"),
    ("number of 5000 digits", TEXT + f"window: {'9' * 5000}\n", "case.yaml"),
    ("number of 400 digits", TEXT + f"window: {'9' * 400}\n", "window"),
    ("rate of 400 digits", TEXT + f"rate: {'9' * 400}\n", "rate"),
    ("rate of 400 digits in time", TEXT.replace("{column: time, unit: s}", f"{{rate: {'9' * 400}}}"), "rate"),
    ("date", TEXT + "window: 2024-01-01\n", "window"),
    ("no model", without("model"), "model"),
    ("no runs", without("runs"), "runs"),
    ("model null", with_(model=None), "model"),
    ("model empty", with_(model=""), "MJCF"),
    ("model a folder", with_(model="."), "MJCF"),
    ("model a device", with_(model="/dev/zero"), "MJCF"),
    ("model the log", with_(model="monday.csv"), "not XML"),
    ("model the case", with_(model="case.yaml"), "not XML"),
    ("model with a long name", with_(model="a" * 5000), "too long"),
    ("data nowhere", with_(data="/no/such/folder"), "monday.csv"),
    ("extends itself", with_(extends="case.yaml"), "extends"),
    ("extends a folder", with_(extends="."), "exist"),
    ("extends a log", with_(extends="monday.csv"), "monday.csv"),
    ("extends a number", with_(extends=5), "extends"),
    ("runs a table", with_(runs={"file": "monday.csv"}), "runs"),
    ("runs empty", with_(runs=[]), "runs"),
    ("run a text", with_(runs=["monday.csv"]), "runs[0]"),
    ("file a number", with_("runs", 0, file=5), "file"),
    ("file empty", with_("runs", 0, file=""), "data "),
    ("file a folder", with_("runs", 0, file="."), "data"),
    ("file with a long name", with_("runs", 0, file="a" * 5000 + ".csv"), "too long"),
    ("file with an escape", with_("runs", 0, file="\x1b[31mmonday.csv"), "printed"),
    ("file turned round", with_("runs", 0, file="\u202evsc.yadnom"), "printed"),
    ("held_out a word", with_("runs", 1, held_out="no"), "held_out"),
    ("start negative", with_("runs", 0, start=-1.0), "start"),
    ("start nan", with_("runs", 0, start=float("nan")), "start"),
    ("start after the end", with_("runs", 0, start=100.0), "monday"),
    ("start after stop", with_("runs", 0, start=3.0, stop=1.0), "monday"),
    ("stop 1e300", with_("runs", 0, start=1e300, stop=2e300), "runs[0]"),
    ("split by nothing", with_("runs", 0, split="day"), "day"),
    ("select a table", with_("runs", 0, select={"day": {"a": 1}}), "select"),
    ("state of nothing", with_("runs", 0, state={"elbow": {"position": 0.0}}), "elbow"),
    ("state too long", with_("runs", 0, state={"shoulder": {"position": [0.0] * 7}}), "shoulder"),
    ("time nothing", with_(time={}), "time"),
    ("time in years", with_(time={"column": "time", "unit": "year"}), "unit"),
    ("time in metres", with_(time={"column": "time", "unit": "m"}), "unit"),
    ("time both", with_(time={"column": "time", "unit": "s", "rate": 50}), "time"),
    ("rate nan", with_(time={"rate": float("nan")}), "rate"),
    ("rate inf", with_(time={"rate": float("inf")}), "rate"),
    ("rate 1e300", with_(time={"rate": 1e300}), "rate"),
    ("rate 1e-300", with_(time={"rate": 1e-300}), "rate"),
    ("grid too fast", with_(rate=1e9), "rate"),
    ("window nan", with_(window=float("nan")), "window"),
    ("window inf", with_(window=float("inf")), "window"),
    ("window 1e300", with_(window=1e300), "window"),
    ("window a list", with_(window=[1, 2]), "window"),
    ("windows 1e300", with_(windows=1e300), "windows"),
    ("accept anything", with_(accept=["everything"]), "accept"),
    ("accept twice", with_(accept=["units", "units"]), "accept"),
    ("nan ignored", with_(nan="ignore"), "nan"),
    ("commands a list", with_(commands=["torque"]), "commands"),
    ("command null", with_("commands", drive=None), "drive"),
    ("column null", with_(*MOTOR, column=None), "column"),
    ("column empty", with_(*MOTOR, column=""), "column"),
    ("column a float", with_(*MOTOR, column=1.5), "column"),
    ("column negative", with_(*MOTOR, column=-1), "column"),
    ("column a million", with_(*MOTOR, column=10**6), "column"),
    ("unit null", with_(*MOTOR, unit=None), "unit"),
    ("unit a number", with_(*MOTOR, unit=1), "unit"),
    ("unit empty", with_(*MOTOR, unit=""), "unit"),
    ("unit of code", with_(*MOTOR, unit="__import__('os').getcwd()"), "unit"),
    ("unit of a bracket", with_(*MOTOR, unit="(((((N m"), "unit"),
    ("unit of 10000 letters", with_(*MOTOR, unit="N m" * 3000), "unit"),
    ("unit of many powers", with_(*MOTOR, unit="N**9**9**9 m"), "unit"),
    ("unit of a large power", with_(*MOTOR, unit="m**999999999"), "unit"),
    ("unit times a factorial", with_(*MOTOR, unit="N m * 9!"), "unit"),
    ("gain nan", with_(*MOTOR, gain="nan N m/V", unit="V"), "gain"),
    ("gain 0", with_(*MOTOR, gain="0 N m/V", unit="V"), "gain"),
    ("gain 1e400", with_(*MOTOR, gain="1e400 N m/V", unit="V"), "gain"),
    ("gain a number", with_(*MOTOR, gain=3), "gain"),
    ("scale 0", with_(*MOTOR, scale=0), "scale"),
    ("scale inf", with_(*MOTOR, scale=float("inf")), "scale"),
    ("scale 1e308", with_(*MOTOR, scale=1e308), "scale"),
    ("scale of 400 digits", TEXT.replace("N m}", f"N m, scale: {'9' * 400}}}"), "scale"),
    ("offset 1e300", with_(*ANGLE, offset=1e300), "offset"),
    ("ratio 0", with_(*MOTOR, meaning="motor", ratio=0), "ratio"),
    ("counts 1e-300", with_(*ANGLE, unit="counts", counts_per_rev=1e-300), "shoulder"),
    ("counts 1e308", with_(*ANGLE, unit="counts", counts_per_rev=1e308), "shoulder"),
    ("noise 0", with_(*ANGLE, noise=0), "noise"),
    ("noise negative", with_(*ANGLE, noise=-1.0), "noise"),
    ("noise inf", with_(*ANGLE, noise=float("inf")), "noise"),
    ("noise 10 rad", with_(*ANGLE, noise=10.0), "noise"),
    ("quantity of a joint", with_(*ANGLE, quantity="force"), "sho"),
    ("two things", with_(*ANGLE, joint="shoulder", body="arm"), "shoulder"),
    ("three columns", with_(*ANGLE, columns=["angle"] * 3), "columns"),
    ("measurements empty", with_(measurements={}), "measurements"),
    ("name with a zero", with_("measurements", **{"a\0b": {"column": "angle", "unit": "rad"}}), "printed"),
    ("name of a line", with_("measurements", **{"a\nb": {"column": "angle", "unit": "rad"}}), "printed"),
    ("unknown a text", with_(unknowns=["mass"]), "unknowns[0]"),
    ("unknown nowhere", with_(unknowns=[{"field": "mass", "site": "leg"}]), "leg"),
    ("unknown colour", with_(unknowns=[{"field": "colour", "site": "arm"}]), "colour"),
    ("unknown twice", with_(unknowns=CASE["unknowns"] * 2), "twice"),
    ("unknown sd 0", with_(unknowns=[{"field": "mass", "site": "arm", "sd": 0}]), "sd"),
    ("unknown sd nan", with_(unknowns=[{"field": "mass", "site": "arm", "sd": float("nan")}]), "sd"),
    ("unknown of the world", with_(unknowns=[{"field": "mass", "site": "world"}]), "world"),
    ("start of nothing", with_(start={"elbow": {"position": 0.0}}), "elbow"),
    ("start a text", with_(start={"shoulder": {"position": "up"}}), "position"),
    ("start too long", with_(start={"shoulder": {"velocity": [0.0, 0.0]}}), "velocity"),
    ("start far away", with_(start={"shoulder": {"position": 1e300}}), "shoulder"),
]  # fmt: skip


@pytest.mark.parametrize(("case", "word"), [own[1:] for own in BAD], ids=[own[0] for own in BAD])
def test_what_cannot_be_used_is_refused(case, word, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, case or b"")
    before = state(tmp_path)
    code = main(["check", "case.yaml"])
    check_refusal(code, *capfd.readouterr(), word)
    assert state(tmp_path) == before
