"""The blind benchmark's graph: diagnosing is given recordings and nothing else, and everything can be resumed."""

import json
import re
import shutil
from pathlib import Path

import pytest
import yaml
from concealed_cases import cases
from conftest import ROOT
from graph import copy, imported, needed, planned, snakemake, stages
from planted import record

from fimpact.benchmark.archive import save_recording
from fimpact.benchmark.rigs.registry import RIGS
from fimpact.benchmark.settings import check
from fimpact.support import tables

SCHEMA = ROOT / "workflow" / "schemas" / "concealed.schema.yaml"
SMOKE = ["--configfile", "config/concealed-smoke.yaml"]
FOLDER = Path("results") / "concealed-smoke"
KNOWING = {"conceal", "reveal", "score", "grade"}  # the rules that may touch sealed/
PICTURES = ("confusion", "held-out", "calibration", "detection")


@pytest.fixture(scope="module")
def fresh(tmp_path_factory) -> Path:
    """A copy of the repository in which nothing was made."""
    return copy(tmp_path_factory.mktemp("fresh"))


def jobs(tree: Path) -> list[tuple[str, list[str], list[str]]]:
    """Every rule of the smoke benchmark with the inputs and outputs of a job."""
    text = snakemake(tree, "concealed", *SMOKE, "--filegraph").stdout
    found = []
    for node in text.split("label=<<table")[1:]:
        rule, (inputs, _, outputs) = re.search(r'"18">(\w+)<', node)[1], node.partition("output &rarr;")
        found.append((rule, *(re.findall(r'"monospace">([^<]+)<', files) for files in (inputs, outputs))))
    assert len(found) > 8
    return found


def test_the_whole_benchmark_is_planned(fresh):
    assert planned(fresh, "concealed", *SMOKE) == {
        **dict.fromkeys(("conceal", "diagnose_concealed", "reveal", "resolve", "peers", "score", "enter", "grade"), 3),
        **{"concealed_cases": 1, "concealed_summary": 1, "concealed_figure": 4, "concealed_entered": 1, "concealed": 1},
    }


def test_the_full_benchmark_has_all_its_parts(fresh):
    assert planned(fresh, "concealed")["diagnose_concealed"] == 60


def test_only_those_who_know_touch_the_seals(fresh):
    touching = {rule for rule, inputs, outputs in jobs(fresh) if any("/sealed/" in path for path in inputs + outputs)}
    assert touching == KNOWING


def test_diagnosing_is_given_recordings_and_code_only(fresh):
    (inputs,) = (inputs for rule, inputs, _ in jobs(fresh) if rule == "diagnose_concealed")
    (data,) = (path for path in inputs if not path.startswith("src/"))
    assert _folder(data) == FOLDER / "recordings"


def test_no_answer_reaches_a_diagnosis(fresh):
    """Nothing that those who know write, apart from recordings, is upstream of diagnosing or of the comparators."""
    graph = jobs(fresh)
    knowing = {_folder(path) for rule, _, outputs in graph if rule in KNOWING for path in outputs}
    for rule, inputs, _ in graph:
        if rule in ("diagnose_concealed", "peers", "enter"):
            assert knowing & {_folder(path) for path in inputs} == {FOLDER / "recordings"}


def _folder(path: str) -> Path:
    return Path(path).parent


def test_the_blind_side_imports_nothing_that_plants():
    benchmark = ROOT / "src" / "fimpact" / "benchmark"
    allowed = {"archive.py", "comparators", "contestant.py", "jsonl.py"}
    for script in ("diagnose_concealed", "resolve", "peers", "enter"):
        paths = imported(ROOT / "workflow" / "scripts" / f"{script}.py")
        own = {path.relative_to(benchmark).parts[0] for path in paths if path.is_relative_to(benchmark)}
        assert own and own <= allowed


@pytest.mark.parametrize(
    ("stage", "scripts"),
    [
        ("conceal", ["conceal", "reveal"]),
        ("diagnose", ["diagnose_concealed", "resolve"]),
        ("peers", ["peers"]),
        ("enter", ["enter"]),
        ("grade", ["grade", "concealed_entered"]),
        ("score", ["score", "concealed_cases"]),
        ("measures", ["concealed_summary"]),
        ("pictures", ["concealed_figure"]),
    ],
)
def test_the_lists_of_package_files_are_complete(stage, scripts):
    package = ROOT / "src" / "fimpact"
    found = set().union(*(imported(ROOT / "workflow" / "scripts" / f"{script}.py") for script in scripts))
    assert needed(found) == needed(package / f"{name}.py" for name in stages()[stage])


def test_the_committed_table_is_drawn_without_a_diagnosis(fresh):
    folder = fresh / "results" / "reference" / "concealed"
    folder.mkdir(parents=True)
    tables.write(cases({"single": 12, "null": 4, "twin": 3}), folder / "cases.csv")
    done = snakemake(fresh, "concealed", "--configfile", "config/reference.yaml", "--cores", "1")
    assert done.returncode == 0, done.stderr
    drawn = fresh / "results" / "redrawn" / "concealed"
    assert all((drawn / f"{name}.svg").exists() for name in PICTURES)
    assert "missed" in (drawn / "measures.md").read_text() or "aim" in (drawn / "measures.md").read_text()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """A copy with the recording of one case, and a configuration of one part."""
    tree = copy(tmp_path_factory.mktemp("recorded"))
    folder = tree / "results" / "one" / "recordings" / "1-of-1"
    folder.mkdir(parents=True)
    save_recording(folder, "1", record(0, lambda model: model.dof_frictionloss.__setitem__(1, 0.02), runs=3))
    one = {
        "results": "results/one",
        "cases": dict.fromkeys(("null", "double", "outside", "twin", "crowd"), 0) | {"single": 1},
    }
    (tree / "one.yaml").write_text(yaml.safe_dump({"concealed": one}))
    return tree


def diagnosed(tree: Path) -> dict:
    """What the rule that diagnoses says of the one case, seconds apart."""
    target = tree / "results" / "one" / "diagnoses" / "1-of-1.jsonl"
    only = ["--allowed-rules", "diagnose_concealed", "--force", "--cores", "1"]
    done = snakemake(tree, str(target.relative_to(tree)), "--configfile", "one.yaml", *only)
    assert done.returncode == 0, done.stderr
    row = json.loads(target.read_text())
    return {name: value for name, value in row.items() if "seconds" not in name}


def test_the_answer_is_the_same_without_the_sealed_folder(recorded):
    sealed = recorded / "results" / "one" / "sealed" / "1-of-1"
    sealed.mkdir(parents=True)
    (sealed / "1.json").write_text('{"kind": "single", "effects": ["gravity_tilt"]}')
    before = diagnosed(recorded)
    shutil.rmtree(sealed.parent)
    assert diagnosed(recorded) == before
    assert "coulomb@joint_2" in before["answer"].split("+")


def settings(override: str = "{}") -> dict:
    full = yaml.safe_load((ROOT / "config" / "concealed.yaml").read_text())
    for key, value in yaml.safe_load(override).items():
        both = isinstance(value, dict)
        full["concealed"][key] = {**full["concealed"][key], **value} if both else value
    return full


def test_the_shipped_benchmarks_are_valid():
    smoke = (ROOT / "config" / "concealed-smoke.yaml").read_text()
    check(settings(), SCHEMA)
    check(settings(json.dumps(yaml.safe_load(smoke)["concealed"])), SCHEMA)
    assert sum(yaml.safe_load(smoke)["concealed"]["cases"].values()) == 8


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("casess: 3", ["concealed.casess is not a key", "did you mean 'cases'?"]),
        ("cases: {singel: 3}", ["concealed.cases.singel", "did you mean 'single'?"]),
        ("cases: {single: -1}", ["concealed.cases.single is -1", "at least 0"]),
        ("cases: {null: 3}", ["concealed.cases.None", "allowed: single, null"]),
        ("rigs: [arm]", ["concealed.rigs[0] is 'arm'", "arm_free, arm_contact, block, six_axis, six_servo, leg"]),
        ("lambda: {single: [30, 3]}", ["concealed.lambda.single is [30, 3]", "swap them"]),
        ("lambda: {single: [0, 3]}", ["concealed.lambda.single[0] is 0", "greater than 0"]),
        ("compared: 2", ["concealed.compared is 2", "at most 1"]),
        ("share: 0", ["concealed.share is 0", "greater than 0"]),
        ("refitted: 0.5", ["concealed.refitted is 0.5", "at most concealed.compared, 0.3333"]),
        ("gathered: some", ["concealed.gathered is 'some'", "all, scored"]),
        ("results: out/", ["concealed.results is 'out/'", "without a slash at its end"]),
        ('cases: {single: 0, "null": 0, double: 0, outside: 0, twin: 0, crowd: 0}', ["at least one case"]),
    ],
)
def test_a_mistake_gets_one_clear_line(override, parts):
    with pytest.raises(ValueError, match=r"^configuration: ") as error:
        check(settings(override), SCHEMA)
    assert "\n" not in str(error.value)
    for part in parts:
        assert part in str(error.value)


def test_the_schema_knows_the_rigs():
    rigs = yaml.safe_load(SCHEMA.read_text())["properties"]["concealed"]["properties"]["rigs"]
    assert set(rigs["items"]["enum"]) == set(RIGS)


def test_what_is_scored_can_be_read_before_the_rest_is(fresh, tmp_path):
    override = ["--config", f"concealed={{results: {tmp_path}/half, gathered: scored}}"]
    refused = snakemake(fresh, "concealed", *SMOKE, *override, "-n")
    assert "holds no part yet" in refused.stderr + refused.stdout
    part = tmp_path / "half" / "scores" / "2-of-3.jsonl"
    part.parent.mkdir(parents=True)
    part.touch()
    assert "score" not in planned(fresh, "concealed", *SMOKE, *override)
