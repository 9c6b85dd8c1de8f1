"""A command may be given anything, and be ended at any time: nothing is overwritten, and nothing is left behind."""

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
import yaml
from bad_input import CASE, MODEL, check_refusal, log, state, table, write

from fimpact.api.commands.console import Teller
from fimpact.cli import main
from fimpact.report.page import reserved
from fimpact.support.atomic_files import draft_folder

FIT = ("fit", "case.yaml", "coulomb@shoulder")
EFFECTS = {
    "effects.py": "from fimpact.effects import EFFECTS\n",
    "broken.py": "def f(:\n",
    "raises.py": "1 / 0\n",
    "exits.py": "import sys; sys.exit('bye')\n",
    "quits.py": "raise SystemExit\n",
    "nan.py": "from fimpact.effects import EFFECTS; EFFECTS['x'] = 3\n",
    "clears.py": "from fimpact.effects import EFFECTS; EFFECTS.clear(); raise KeyError\n",
    "recursion.py": "def f(): f()\nf()\n",
    "notes.txt": "x = 1\n",
    "pages/mine.txt": "x",
    "answers/diagnosis.json": "{",
    "older/diagnosis.json": '{"members": [], "answer": "none"}',
    "lists/diagnosis.json": "[1, 2]",
    "texts/diagnosis.json": '"hello"',
    "binary/diagnosis.json": b"\xff\xfe\0",
}
BAD = [  # the command, a word of the refusal
    ((), "COMMAND"),
    (("dance",), "dance"),
    (("check",), "CASE.yaml"),
    (("check", "nothing.yaml"), "nothing.yaml"),
    (("check", "."), "exist"),
    (("check", "case.yaml", "case.yaml"), "case.yaml"),
    (("check", "monday.csv"), "monday.csv"),
    (("check", "arm.xml"), "arm.xml"),
    (("check", "a" * 5000), "too long"),
    (("check", "\x1b[2J.yaml"), "exist"),
    (("check", "case\n.yaml"), "exist"),
    (("check", "case.yaml", "--data", "nowhere"), "monday.csv"),
    (("check", "case.yaml", "--data", "case.yaml"), "monday.csv"),
    (("check", "case.yaml", "--dat"), "--data"),
    (("init", "arm.xml"), "LOG"),
    (("init", "arm.xml", "monday.csv"), "exists"),
    (("init", "arm.xml", "monday.csv", "-o", "."), "exists"),
    (("init", "arm.xml", "monday.csv", "-o", "nowhere/case.yaml"), "nowhere"),
    (("init", "arm.xml", "monday.csv", "-o", "arm.xml/case.yaml"), "arm.xml"),
    (("init", "arm.xml", "monday.csv", "-o", "/proc/case.yaml"), "/proc/case.yaml"),
    (("init", "arm.xml", "nothing.csv", "-o", "new.yaml"), "nothing.csv"),
    (("init", "nothing.xml", "monday.csv", "-o", "new.yaml"), "nothing.xml"),
    (("init", "monday.csv", "arm.xml", "-o", "new.yaml"), "monday.csv"),
    (("init", "arm.xml", "arm.xml", "-o", "new.yaml"), "format"),
    (("fit", "case.yaml"), "EFFECT@SITE"),
    (("fit", "case.yaml", "coulomb"), "place"),
    (("fit", "case.yaml", "@shoulder"), "effect"),
    (("fit", "case.yaml", "coulomb@"), "site"),
    (("fit", "case.yaml", "coulomb@elbow"), "elbow"),
    (("fit", "case.yaml", "colomb@shoulder"), "did you mean 'coulomb'"),
    (("fit", "case.yaml", "coulomb@shoulder", "coulomb@shoulder"), "twice"),
    (("fit", "case.yaml", "x" * 3000 + "@shoulder"), "not found"),
    ((*FIT, "-o", "."), "folder"),
    ((*FIT, "-o", "nowhere/out.json"), "nowhere"),
    ((*FIT, "-o", "arm.xml"), "arm.xml"),
    ((*FIT, "-o", "tuesday.csv"), "tuesday.csv"),
    ((*FIT, "-o", "./pages/../case.yaml"), "case.yaml"),
    ((*FIT, "-o", "link.json"), "case.yaml"),
    ((*FIT, "-o", "/dev/null"), "/dev/null"),
    ((*FIT, "-o", "/proc/out.json"), "/proc/out.json"),
    ((*FIT, "-o", "effects.py", "--effects", "effects.py"), "effects.py"),
    ((*FIT, "-o", "a" * 300), "too long"),
    (("diagnose", "case.yaml", "--out", "."), "no report"),
    (("diagnose", "case.yaml", "--out", "pages"), "mine.txt"),
    (("diagnose", "case.yaml", "--out", "case.yaml"), "case.yaml"),
    (("diagnose", "case.yaml", "--out", "case.yaml/page"), "case.yaml"),
    (("diagnose", "case.yaml", "--out", "/proc/a/b/page"), "/proc/a/b/page"),
    (("diagnose", "case.yaml", "--out", "/dev/null"), "/dev/null"),
    (("diagnose", "case.yaml", "--out", "a" * 300), "too long"),
    (("diagnose", "case.yaml", "--only", "magic"), "family"),
    (("diagnose", "case.yaml", "--only", "friction,masses"), "family"),
    (("diagnose", "case.yaml", "--budget", "0"), "budget"),
    (("diagnose", "case.yaml", "--budget", "-3"), "budget"),
    (("diagnose", "case.yaml", "--budget", "nan"), "budget"),
    (("diagnose", "case.yaml", "--budget", "inf"), "budget"),
    (("diagnose", "case.yaml", "--budget", "soon"), "budget"),
    (("diagnose", "case.yaml", "--effects", "nothing.py"), "nothing.py"),
    (("diagnose", "case.yaml", "--effects", "."), "not a file"),
    (("diagnose", "case.yaml", "--effects", "notes.txt"), "notes.txt"),
    (("diagnose", "case.yaml", "--effects", "monday.csv"), "monday.csv"),
    *((("diagnose", "case.yaml", "--effects", name), name) for name in EFFECTS if name.endswith(".py")),
    (("resolve", "case.yaml"), "diagnose"),
    (("resolve", "case.yaml", "--out", "case.yaml"), "diagnose"),
    *((("resolve", "case.yaml", "--out", name[:-15]), "diagnosis") for name in EFFECTS if name.endswith(".json")),
    (("effects", "now", "please", "all"), "all"),
    (("keys", "case.yaml"), "case.yaml"),
]  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The good case and files that no command should take for what it wants, in the folder where commands run."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path, files=EFFECTS)
    (tmp_path / "link.json").symlink_to("case.yaml")
    return tmp_path


@pytest.mark.parametrize(("command", "word"), BAD, ids=[" ".join(command)[:60] for command, _ in BAD])
def test_a_command_that_cannot_be_done_is_refused_before_the_work(command, word, folder, capfd):
    before = state(folder)
    try:
        code = main(command)
    except SystemExit as ended:
        code = ended.code
    check_refusal(code, *capfd.readouterr(), word)
    assert state(folder) == before


def test_a_log_in_the_folder_of_the_page_is_kept(folder, capfd):
    (folder / "page").mkdir()
    (folder / "page" / "experiment.csv").write_text(table(log(1.0)))
    case = yaml.safe_load(yaml.safe_dump(CASE))
    case["runs"][0]["file"] = "page/experiment.csv"
    (folder / "case.yaml").write_text(yaml.safe_dump(case))
    before = state(folder)
    check_refusal(main(["diagnose", "case.yaml", "--out", "page"]), *capfd.readouterr(), "page/experiment.csv")
    assert state(folder) == before


def test_the_version_and_all_keys_are_told(folder, capfd):
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capfd.readouterr().out.startswith("fimpact ")
    assert main(["keys"]) == 0
    said = capfd.readouterr().out
    assert "counts_per_rev" in said and "ball_drops" not in said


def test_help_comes_at_once():
    code = "import sys, time, fimpact.cli as c\ntry: c.main(['--help'])\nexcept SystemExit: print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not {"mujoco", "numpy", "jsonschema", "jax"} & set(said.split())


def started(folder: Path) -> subprocess.Popen:
    """A diagnosis that has begun its work."""
    command = [sys.executable, "-m", "fimpact.cli", "diagnose", "case.yaml", "--out", "new/page"]
    # A shell makes what it runs in the background ignore SIGINT, and so would the diagnosis.
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    piped = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    process = subprocess.Popen(command, cwd=folder, preexec_fn=heard, **piped)
    for line in process.stderr:
        if line.startswith("preparing"):
            return process
    raise AssertionError("it never began")


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_what_is_interrupted_leaves_nothing(folder, end):
    before = state(folder)
    process = started(folder)
    process.send_signal(end)
    said, error = process.communicate(timeout=30)
    assert process.returncode == 130 and not said
    assert error.splitlines()[-1] == "fimpact: interrupted; nothing was written"
    assert state(folder) == before


def test_what_is_killed_is_cleared_by_the_next(folder):
    process = started(folder)
    process.kill()
    process.communicate()
    assert [path.name.startswith(".page-draft-") for path in (folder / "new").iterdir()] == [True]
    with reserved(folder / "new" / "page") as building:
        assert list((folder / "new").iterdir()) == [building]
    assert not list((folder / "new").iterdir())


def test_a_draft_that_is_held_is_not_cleared(tmp_path):
    with draft_folder(tmp_path) as one, draft_folder(tmp_path) as other:
        assert one.is_dir() and other.is_dir() and one != other
    assert not list(tmp_path.iterdir())


def test_other_folders_are_not_cleared(tmp_path):
    (tmp_path / "drafts").mkdir()
    (tmp_path / ".draft-link").symlink_to(tmp_path / "drafts")
    with draft_folder(tmp_path):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == [".draft-link", "drafts"]


def test_a_fault_of_ours_is_a_line_too(folder, capfd, monkeypatch):
    def fail(*_):
        raise RuntimeError("two\nlines")

    monkeypatch.setattr("fimpact.cases.case.load", fail)
    assert main(["check", "case.yaml"]) == 1
    said = capfd.readouterr().err
    assert len(said.splitlines()) == 1 and "fault of fimpact" in said and "two lines" in said
    monkeypatch.setenv("FIMPACT_TRACEBACK", "1")
    assert main(["check", "case.yaml"]) == 1
    assert "Traceback" in capfd.readouterr().err


def test_a_terminal_without_unicode_gets_the_words(folder):
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0", "LC_ALL": "C"}
    (folder / "arm.xml").write_text(MODEL.replace('"shoulder"', '"Schülter"'), encoding="utf-8")
    case = yaml.safe_load(yaml.safe_dump(CASE))
    case["measurements"] = {"Schülter": case["measurements"]["shoulder"]}
    (folder / "case.yaml").write_text(yaml.safe_dump(case, allow_unicode=True), encoding="utf-8")
    command = [sys.executable, "-m", "fimpact.cli", "check", "case.yaml"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert b"Sch" in done.stdout


def test_counts_come_with_rate_and_time_left(capsys):
    now = iter([0.0, 2.0, 4.0, 4.5, 20.0, 22.0])
    tell = Teller(lambda: next(now))
    for step in (1, 2, 3, 20):
        tell(f"smoothing: step {step} of at most 20, a")
    tell("proving")
    assert capsys.readouterr().err.splitlines() == [
        "smoothing: step 1 of at most 20, a (0.5 a second, at most 38 s left)",
        "smoothing: step 2 of at most 20, a (0.5 a second, at most 36 s left)",
        "smoothing: step 20 of at most 20, a",
        "proving",
    ]
