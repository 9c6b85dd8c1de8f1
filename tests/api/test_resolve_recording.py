"""The command that says which name is left: it needs an earlier diagnosis, the same files and a new run."""

import json
import shutil
from types import SimpleNamespace

import pytest
import yaml
from case_files import write_csv
from recorded import ROD, record, waves
from test_diagnose_recording import CASE

from fimpact.cases import inputs
from fimpact.cli import main
from fimpact.report.contents import describe_inputs

MEMBERS = [{"viscous@pivot": {"damping": 0.01}}, {"coulomb@pivot": {"friction": 0.015}}]
NEW = {"file": "d.csv"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A pendulum with a dry pivot in four logs, of which the diagnosis knew three."""
    folder = tmp_path_factory.mktemp("rod")
    commands = [waves(400, [0.5], seed) for seed in range(4)]
    recording = record(ROD, ("angle",), commands, 1e-3, lambda model: model.dof_frictionloss.__setitem__(0, 0.02))
    for name, run in zip("abcd", recording.runs, strict=True):
        time = [f"{k * 0.01:.2f}" for k in range(len(run.measured))]
        write_csv(folder / f"{name}.csv", {"t": time, "u": run.ctrl[:, 0].tolist(), "q": run.measured[:, 0].tolist()})
    (folder / "rod.xml").write_text(ROD)
    return folder


@pytest.fixture
def asked(folder, capsys, monkeypatch):
    """Exit code and what was said, after a diagnosis and a case that may be spoiled."""
    monkeypatch.setattr(
        "fimpact.api.commands.console.SECOND", 0.0
    )  # a quick machine takes its first steps within a second

    def asked(runs=(NEW,), members=MEMBERS, **spoiled):
        (folder / "case.yaml").write_text(yaml.safe_dump(CASE))
        told = {"answer": "viscous@pivot", "members": members, "runs": ["a", "b", "c"]}
        told["provenance"] = describe_inputs(inputs(folder / "case.yaml"))
        (folder / "page").mkdir(exist_ok=True)
        (folder / "page" / "diagnosis.json").write_text(json.dumps(told | spoiled))
        (folder / "case.yaml").write_text(yaml.safe_dump(CASE | {"runs": [*CASE["runs"], *runs]}))
        code = main(["resolve", str(folder / "case.yaml"), "--out", str(folder / "page")])
        return code, *capsys.readouterr()

    return asked


def test_the_name_that_the_further_run_bears_out_is_left(asked):
    code, said, progress = asked()
    assert code == 0 and said.splitlines() == [
        "100%  coulomb at pivot",
        "  0%  viscous at pivot",
        "Left: coulomb at pivot.",
    ]
    assert progress.startswith("diagnosing anew with d: viscous@pivot, coulomb@pivot could not be told apart\n")


@pytest.mark.parametrize(
    ("spoiled", "complaint"),
    [
        ({"runs": ()}, "has no run that was not diagnosed"),
        ({"runs": ({**NEW, "held_out": True},)}, "remove held_out"),
        ({"provenance": {"inputs": {"rod.xml": "another"}}}, "rod.xml is not the file that was diagnosed"),
        ({"provenance": {}}, "no diagnosis of this version"),
    ],
)
def test_what_cannot_be_resolved_is_said_in_a_line(asked, spoiled, complaint):
    code, said, error = asked(**spoiled)
    assert code == 2 and not said and complaint in error.splitlines()[-1]


def test_a_name_that_is_left_already_is_said(asked):
    code, said, _ = asked(runs=(), members=MEMBERS[:1])
    assert code == 0 and said.startswith("Left: viscous at pivot. The diagnosis left no other name")


@pytest.mark.parametrize(
    ("found", "said"), [("none", "nothing that is missing"), ("unnamed", "something without a name")]
)
def test_that_no_name_is_left_is_said_in_words(asked, monkeypatch, found, said):
    left = SimpleNamespace(members=(), answer=found, answer_set=[found])
    monkeypatch.setattr("fimpact.diagnosis.experiments.resolve.diagnose", lambda *given, **options: left)
    assert asked()[1].splitlines()[-1] == f"Left: {said}."


def test_a_new_log_may_have_the_name_of_an_old_one(asked, folder):
    (folder / "later").mkdir(exist_ok=True)
    shutil.copy(folder / "d.csv", folder / "later" / "a.csv")
    code, said, _ = asked(runs=({"file": "later/a.csv", "name": "e"},))
    assert code == 0 and said.splitlines()[-1] == "Left: coulomb at pivot."


def test_a_run_that_was_diagnosed_must_stay(asked, folder, capsys):
    asked()
    (folder / "case.yaml").write_text(yaml.safe_dump(CASE | {"runs": [*CASE["runs"][1:], NEW]}))
    assert main(["resolve", str(folder / "case.yaml"), "--out", str(folder / "page")]) == 2
    assert "no longer has the run a" in capsys.readouterr().err


def test_without_a_diagnosis_it_says_how_to_make_one(folder, capsys):
    assert main(["resolve", str(folder / "case.yaml"), "--out", str(folder / "nowhere")]) == 2
    assert "run `fimpact diagnose" in capsys.readouterr().err
