"""The graph of the recordings: what is published is fetched, what is there is left alone, what is missing is named."""

import hashlib
from pathlib import Path

import pandas as pd
import pytest
import yaml
from conftest import ROOT, marked
from graph import copy, imported, needed, planned, snakemake, stages
from web_server import CONTENT, serving

from fimpact.benchmark.comparators.rig_summary import to_markdown
from fimpact.support.schema_check import check_keys

SCHEMA = ROOT / "workflow" / "schemas" / "recordings.schema.yaml"
PAGE = "results/recordings/ball_drops/report.html"
REFERENCE = ROOT / "results" / "reference" / "recordings" / "summary.csv"


@pytest.fixture
def tree(tmp_path) -> Path:
    """A copy of the repository in which nothing was made and no data are."""
    return copy(tmp_path / "tree")


def give(tree: Path, *files: str) -> None:
    for file in files:
        path = tree / "data" / "recordings" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("data")


def offer(tree: Path, *rows: dict) -> None:
    (tree / "config" / "recordings" / "sources.yaml").write_text(yaml.safe_dump(list(rows)))


def test_published_data_are_fetched_first(tree):
    give(tree, "emps/DATA_EMPS.mat")
    assert planned(tree, "results/recordings/emps/report.html") == {"fetch": 1, "diagnose_recording": 1}


def test_all_rigs_are_planned(tree):
    arm = (f"gen3/{run}.csv" for run in ("sweep_a", "sweep_b", "quadratic", "validation_1", "validation_2"))
    give(tree, "ball_drops/ball_drops.csv", "cube_tosses/tosses_000-399.npz", *arm)
    cases = len(list((tree / "config" / "recordings").glob("*.yaml"))) - 1  # sources.yaml is none
    every = {"diagnose_recording": cases, "compare_recording": cases, "fetch": 13, "recordings_summary": 1}
    assert planned(tree, "recordings") == every | {"recordings": 1}


def test_a_page_is_one_job_once_its_data_are_there_or_elsewhere(tree):
    give(tree, "ball_drops/ball_drops.csv")
    (tree / "data" / "recordings").rename(tree / "elsewhere")
    assert planned(tree, PAGE, "--config", "recordings={data: elsewhere}") == {"diagnose_recording": 1}


def test_data_that_nobody_offers_are_named_in_one_line(tree):
    done = snakemake(tree, PAGE, "--dry-run")
    assert done.returncode != 0
    assert done.stderr.splitlines()[-1].startswith("data/recordings/ball_drops/ball_drops.csv does not exist, and")


def test_a_case_that_is_wrong_is_named_in_one_line(tree):
    (tree / "config" / "recordings" / "ball_drops.yaml").write_text("modell: a.xml\n")
    last = snakemake(tree, PAGE, "--dry-run").stderr.splitlines()[-1]
    assert "modell is not a key" in last and "did you mean 'model'" in last


def test_fetching_ends_with_the_right_file_or_with_none(tree, tmp_path):
    good = hashlib.sha256(CONTENT).hexdigest()
    with serving(tmp_path / "served") as address:
        row = {"url": f"{address}/log.bin", "licence": "MIT"}
        offer(tree, row | {"file": "rig/good.bin", "sha256": good}, row | {"file": "rig/bad.bin", "sha256": "0" * 64})
        done = snakemake(tree, "fetch_all", "--cores", "1", "--keep-going")
    assert done.returncode != 0 and "not the one expected" in done.stderr
    folder = tree / "data" / "recordings" / "rig"
    assert [path.name for path in folder.iterdir()] == ["good.bin"]
    assert (folder / "good.bin").read_bytes() == CONTENT
    assert planned(tree, "fetch_all") == {"fetch": 1, "fetch_all": 1}  # the one that is missing still


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ({"dta": "x"}, ["recordings.dta is not a key", "did you mean 'data'?"]),
        ({"limit": 0}, ["recordings.limit is 0", "greater than 0"]),
        ({"data": "x/"}, ["recordings.data is 'x/'", "without a slash"]),
        ({"cases": ["bal"]}, ["recordings.cases[0] is 'bal'", "allowed: arm, ball", "did you mean 'ball'?"]),
    ],
)
def test_a_mistake_gets_one_clear_line(override, parts):
    settings = yaml.safe_load((ROOT / "config" / "recordings.yaml").read_text())
    check_keys(settings, SCHEMA, case=["arm", "ball"])
    settings["recordings"] |= override
    with pytest.raises(ValueError, match=r"^configuration: ") as error:
        check_keys(settings, SCHEMA, case=["arm", "ball"])
    assert "\n" not in str(error.value) and all(part in str(error.value) for part in parts)


@pytest.mark.parametrize("script", ["diagnose_recording", "compare_recording", "recordings_summary"])
def test_the_lists_of_package_files_are_complete(script):
    package = ROOT / "src" / "fimpact"
    listed = needed(package / f"{name}.py" for name in stages()[script])
    assert needed(imported(ROOT / "workflow" / "scripts" / f"{script}.py")) == listed


@pytest.mark.skipif(not REFERENCE.exists(), reason=f"the recordings' table was not committed yet: {REFERENCE}")
def test_the_page_shows_the_committed_table():
    assert marked(ROOT / "docs" / "rigs.md", "recordings") == to_markdown(pd.read_csv(REFERENCE, dtype={"run": str}))
