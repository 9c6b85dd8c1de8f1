"""The worked example of docs/index.md: from its own text to the page, and the effect of docs/add-effect.md."""

import json
import re

import pytest
from conftest import ROOT

from fimpact.cli import main
from fimpact.effects import EFFECTS
from fimpact.effects.plugins import load_effects
from fimpact.export.callback import SourceBundle

START = (ROOT / "docs" / "index.md").read_text()


def block(marker: str) -> str:
    """The fenced block that follows a marker."""
    return re.search(re.escape(marker) + r"\n```\w+\n(.*?)```", START, re.S)[1]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(block("<!-- example -->"), {})
        (folder / "case.yaml").write_text(block("<!-- example case -->"))
        assert main(["check", "case.yaml"]) == 0
        assert main(["diagnose", "case.yaml", "--out", "page"]) == 0
    return folder / "page"


def test_the_example_finds_the_friction_that_it_hides(made):
    found = json.loads((made / "diagnosis.json").read_text())
    assert found["answer"] == "coulomb@shoulder" and found["runs"] == ["monday", "tuesday"]
    assert [list(member) for member in found["members"]] == [["coulomb@shoulder"]]
    (effect,) = found["effects"]
    assert effect["tier"] == "certain" and effect["coefficients"][0]["value"] == pytest.approx(0.03, rel=0.02)
    for page in ("README.md", "docs/index.md"):
        assert f"\n{found['verdict']}\n" in (ROOT / page).read_text()


def test_the_example_leaves_a_page_and_a_better_model(made):
    assert {"report.html", "diagnosis.json", "timing.json", "improved.xml"} <= {path.name for path in made.iterdir()}
    assert "frictionloss" in (made / "improved.xml").read_text()


@pytest.fixture
def catalogue():
    before = dict(EFFECTS)
    yield EFFECTS
    EFFECTS.clear()
    EFFECTS.update(before)


def test_an_effect_of_ones_own_is_a_function_and_a_registry_line(catalogue, tmp_path, capsys):
    """The printed file, as `--effects` takes it; an exported model takes the source of its law along."""
    text = re.search(r"```python\n(.*?)```", (ROOT / "docs" / "add-effect.md").read_text(), re.S)[1]
    shared = text.replace("(position / 0.05) ** 2", "reach(position)")
    (tmp_path / "magnet.py").write_text("def reach(position):\n    return (position / 0.05) ** 2\n\n\n" + shared)
    assert load_effects(tmp_path / "magnet.py") == ["magnet"]
    assert main(["effects"]) == 0 and "magnet  " in capsys.readouterr().out
    bundle = SourceBundle({})
    assert bundle.add(catalogue["magnet"].law) == "magnet" and "(position / 0.05) ** 2" in bundle.text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "is not a file"),
        ("x = 1", "adds no effect"),
        ("import fimpact.nothing", "ModuleNotFoundError"),
        ("EFFECTS[", "SyntaxError"),
        ("from fimpact.effects import EFFECTS\nEFFECTS['half'] = None", "must be an Effect of that name"),
        ("from fimpact.effects import EFFECTS\nEFFECTS['half'] = None\nraise OSError('done')", "OSError"),
    ],
)
def test_a_file_that_adds_nothing_gets_one_line(made, catalogue, tmp_path, capsys, text, said):
    path, before = tmp_path / "own.py", list(catalogue)
    if text:
        path.write_text(text)
    out = tmp_path / "page"
    assert main(["diagnose", str(made.parent / "case.yaml"), "--effects", str(path), "--out", str(out)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and said in lines[0] and "own.py" in lines[0]
    assert list(catalogue) == before and not out.exists()
