"""A log may hold anything: what cannot be used is refused in a line that names the file or the column."""

import gzip
import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import yaml
from bad_input import CASE, altered, check_refusal, log, state, table, write
from pyarrow import parquet
from scipy.io import savemat

from fimpact.cli import main

GOOD = table(log(1.0))
HEAD, *ROWS = GOOD.splitlines()
LINES = "\n".join
GARBAGE = np.random.default_rng(0).bytes(5000)


def csv(text: str | bytes, name: str = "monday.csv"):
    """The good case, whose first log is this text."""
    return CASE, {name: text}


def other(name: str, content) -> tuple[dict, dict]:
    """The good case, whose first log is another file."""
    case = yaml.safe_load(yaml.safe_dump(CASE))
    case["runs"][0]["file"] = name
    return case, {name: content}


def at(row: int, value: float):
    """A change of one value."""
    return lambda values: np.concatenate([values[:row], [value], values[row + 1 :]])


def both(**laws):
    return CASE, altered(**laws)


def npz(**arrays) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def bomb() -> bytes:
    """A ZIP whose only entry says that it has 8 GB."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("angle.npy", b"0" * 1000)
    return file.getvalue().replace(struct.pack("<I", 1000), struct.pack("<I", 0xFFFFFFF0))


def written(**columns):
    return lambda path: parquet.write_table(pa.table(columns), path)


def mat(**variables):
    return lambda path: savemat(path, variables)


def columns(**changed) -> dict:
    return {name: pa.array(own) for name, own in log(1.0).items()} | changed


N = len(log(1.0)["time"])
BAD = [  # what is wrong, the case and its files, a word of the refusal
    ("nothing", csv(""), "monday.csv"),
    ("a blank line", csv("\n\n"), "monday.csv"),
    ("only names", csv(HEAD), "monday"),
    ("one row", csv(LINES([HEAD, ROWS[0]])), "monday"),
    ("seven rows", csv(LINES([HEAD, *ROWS[:7]])), "samples"),
    ("no names", csv(LINES(ROWS)), "monday"),
    ("names twice", csv(GOOD.replace("torque", "angle")), "angle"),
    ("names without a name", csv(GOOD.replace("torque", "").replace("angle", "")), "monday"),
    ("one column", csv(LINES(row.split(",")[0] for row in [HEAD, *ROWS])), "monday"),
    ("garbage", csv(GARBAGE), "monday"),
    ("zeros", csv(b"\0" * 5000), "monday"),
    ("zeros between", csv(GOOD.replace(",", ",\0")), "monday"),
    ("utf-16", csv(GOOD.encode("utf-16")), "monday"),
    ("latin-1", csv(GOOD.replace("angle", "Anglé").encode("latin-1")), "monday"),
    ("html", csv("<!DOCTYPE html><html><body>Sign in</body></html>"), "monday"),
    ("compressed", csv(gzip.compress(GOOD.encode())), "monday"),
    ("a sheet", csv(bomb()), "monday"),
    ("a row too long", csv(LINES([HEAD, *ROWS[:50], ROWS[50] + ",1,2", *ROWS[51:]])), "monday"),
    ("a row too short", csv(LINES([HEAD, *ROWS[:50], "0.1,0.2", *ROWS[51:]])), "monday"),
    ("an open quote", csv(LINES([HEAD, *ROWS[:50], '"1.0', *ROWS[51:]])), "monday"),
    ("names in the middle", csv(LINES([HEAD, *ROWS[:50], HEAD, *ROWS[50:]])), "monday"),
    ("a word", csv(GOOD.replace(ROWS[50], "1.0,off,0.2")), "off"),
    ("a cell of 100000 letters", csv(GOOD.replace(ROWS[50], f"1.0,{'x' * 100_000},0.2")), "torque"),
    ("an escape", csv(GOOD.replace(ROWS[50], "1.0,\x1b[2J,0.2")), "torque"),
    ("decimal commas", csv(GOOD.replace(",", ";").replace(".", ",")), "monday"),
    ("numbers with units", csv(LINES([HEAD, *(f"{row} rad" for row in ROWS)])), "rad"),
    ("inf", both(angle=at(60, np.inf)), "angle"),
    ("-inf in commands", both(torque=at(60, -np.inf)), "torque"),
    ("nan", both(angle=at(60, np.nan)), "nan"),
    ("all nan", both(angle=lambda q: np.full(len(q), np.nan)), "angle"),
    ("1e300", both(angle=lambda q: 1e300 * q), "angle"),
    ("1e300 once", both(angle=at(60, 1e300)), "angle"),
    ("commands 1e300", both(torque=lambda u: 1e300 * u), "torque"),
    ("commands constant", both(torque=np.ones_like), "drive"),
    ("angle constant", both(angle=np.ones_like), "same numbers"),
    ("angle zero", both(angle=np.zeros_like), "same numbers"),
    ("angle denormal", both(angle=lambda q: 1e-315 * q), "shoulder"),
    ("time zero", both(time=np.zeros_like), "time"),
    ("time backward", both(time=lambda t: t[::-1]), "time"),
    ("time nan", both(time=at(60, np.nan)), "time"),
    ("time inf", both(time=at(60, np.inf)), "time"),
    ("time starts again", both(time=lambda t: np.concatenate([t[:100], t[:100]])), "time"),
    ("time in ns", both(time=lambda t: 1e9 * t), "time"),
    ("time in years", both(time=lambda t: t / 3e7), "time"),
    ("time 1e300", both(time=lambda t: 1e300 * t), "time"),
    ("time with a leap", both(time=lambda t: np.where(t > 2, t + 1e6, t)), "missing"),
    ("another day", csv(table(log(1.0) | {"time": log(1.0)["time"] + 1e300})), "time"),
    ("unknown format", other("log.xyz", "1"), "format"),
    ("no ending", other("log", GOOD), "format"),
    ("compressed by its name", other("log.csv.gz", gzip.compress(GOOD.encode())), "format"),
    ("parquet of garbage", other("log.parquet", GARBAGE), "log.parquet"),
    ("parquet of nothing", other("log.parquet", b""), "log.parquet"),
    ("parquet without rows", other("log.parquet", written(time=pa.array([], pa.float64()))), "log.parquet"),
    ("parquet of texts", other("log.parquet", written(**columns(angle=pa.array(["up"] * N)))), "angle"),
    ("parquet of null", other("log.parquet", written(**columns(angle=pa.nulls(N)))), "no measured value"),
    ("parquet of bytes", other("log.parquet", written(**columns(angle=pa.array([b"x"] * N)))), "angle"),
    ("parquet of maps", other("log.parquet", written(**columns(angle=pa.array([{"a": 1.0}] * N)))), "angle"),
    ("npz of garbage", other("log.npz", GARBAGE), "log.npz"),
    ("npz cut off", other("log.npz", npz(**log(1.0))[:-300]), "log.npz"),
    ("npz that is too large", other("log.npz", bomb()), "log.npz"),
    ("npz of objects", other("log.npz", npz(**log(1.0) | {"angle": np.array([{}] * N, object)})), "angle"),
    ("npz of complex", other("log.npz", npz(**log(1.0) | {"angle": 1j * log(1.0)["angle"]})), "angle"),
    ("npz of cubes", other("log.npz", npz(**log(1.0) | {"angle": np.ones((3, 3, 3))})), "angle"),
    ("npz of nothing", other("log.npz", npz(**log(1.0) | {"angle": np.ones(0)})), "no measured value"),
    ("npz shorter", other("log.npz", npz(**log(1.0) | {"angle": log(1.0)["angle"][:50]})), "angle"),
    ("mat of garbage", other("log.mat", GARBAGE), "log.mat"),
    ("mat of nothing", other("log.mat", mat()), "log.mat"),
    ("mat of texts", other("log.mat", mat(**log(1.0) | {"angle": "up"})), "angle"),
    ("mcap of garbage", other("log.mcap", GARBAGE), "log.mcap"),
    ("mcap of nothing", other("log.mcap", b""), "log.mcap"),
    ("mcap that was not closed", other("log.mcap", b"\x89MCAP0\r\n" + GARBAGE), "log.mcap"),
]


@pytest.mark.parametrize(("case", "word"), [own[1:] for own in BAD], ids=[own[0] for own in BAD])
def test_what_cannot_be_used_is_refused(case, word, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, case[0], files=case[1])
    before = state(tmp_path)
    code = main(["check", "case.yaml"])
    check_refusal(code, *capfd.readouterr(), word)
    assert state(tmp_path) == before


@pytest.mark.parametrize(("case", "word"), [own[1:] for own in BAD[:7] + BAD[10:19]], ids=range(16))
def test_init_makes_no_case_of_what_it_cannot_read(case, word, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, case[0], files=case[1])
    (tmp_path / "case.yaml").unlink()
    code = main(["init", "arm.xml", "monday.csv", "-o", "case.yaml"])
    said, error = capfd.readouterr()
    if code:
        check_refusal(code, said, error, "")
    assert Path("case.yaml").exists() == (code == 0)
