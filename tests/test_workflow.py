"""The graph: what is asked for is what runs, and an edit reruns what depends on it and nothing else."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT
from graph import copy, imported, planned, snakemake, stages

SMOKE = ["--configfile", "config/smoke.yaml"]
WHOLE = ["all", "curve", *SMOKE]
DRAWN = {"panels", "ablation", "curve"}
SIMULATED = {"trials", "sweep", "reach", "plans", "identifiability"}


@pytest.fixture(scope="module")
def fresh(tmp_path_factory) -> Path:
    """A copy of the repository in which nothing was made."""
    return copy(tmp_path_factory.mktemp("fresh"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A copy in which every file of the smoke workflow counts as made."""
    tree = copy(tmp_path_factory.mktemp("finished"))
    listed = snakemake(tree, *WHOLE, "--summary").stdout.splitlines()[1:]
    for path in (tree / line.split("\t")[0] for line in listed):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(path.name)
    assert snakemake(tree, *WHOLE, "--touch", "--forceall").returncode == 0
    return tree


@pytest.fixture
def edited(finished, request) -> Iterator[Path]:
    """The finished copy after an edit of the package file in `request.param`."""
    path = finished / "src" / "fimpact" / request.param
    before = path.read_text()
    path.write_text(before + "\n")
    yield finished
    path.write_text(before)


def test_one_figure_needs_only_its_own_table(fresh):
    assert planned(fresh, "results/smoke/ablation.png", *SMOKE) == {
        "ablation": 1,
        "compile": 2,
        "gather": 1,
        "trials": 12,
    }


def test_one_part_is_one_job(fresh):
    assert planned(fresh, "results/smoke/sweep/arm-fisher-1-of-1.csv", *SMOKE) == {"compile": 1, "sweep": 1}


def test_more_parts_than_seeds_leave_none_empty(fresh):
    jobs = planned(fresh, "results/smoke/trials.csv", *SMOKE, "--set-scatter", "seeds=20")
    assert jobs == {"compile": 2, "gather": 1, "trials": 22}  # contact_implicit runs on the first seed alone


def test_committed_tables_are_drawn_without_a_simulation(fresh):
    folder = fresh / "results" / "reference" / "paper"
    folder.mkdir(parents=True)
    for name in ("trials", "diagnostics", "sweep", "reach"):
        (folder / f"{name}.csv").touch()
    jobs = planned(fresh, "--configfile", "config/reference.yaml")
    shutil.rmtree(folder)
    assert jobs == dict.fromkeys([*DRAWN, "summary"], 1)


def test_a_bad_configuration_gets_one_line_and_nothing_is_written(fresh):
    done = snakemake(fresh, *SMOKE, "--config", "rounds=0")
    assert done.returncode != 0
    lines = [line for line in done.stderr.splitlines() if not line.startswith(("Using workflow", "Config file"))]
    assert len(lines) == 1
    assert lines[0].startswith("configuration: rounds is 0; it must be at least 1")
    assert not (fresh / "results" / "smoke").exists()


def test_no_rule_asks_for_all_cores_of_which_a_cluster_has_no_number():
    rules = [path.read_text() for path in (ROOT / "workflow" / "rules").glob("*.smk")]
    assert rules and not any("workflow.cores" in text for text in rules)


def test_nothing_runs_twice(finished):
    assert planned(finished, *WHOLE) == {}


@pytest.mark.parametrize(
    ("edited", "rules"),
    [("report/plotting/style.py", DRAWN | {"example", "forces"}), ("support/progress.py", set())],
    indirect=["edited"],
)
def test_an_edit_reruns_what_depends_on_it(edited, rules):
    assert set(planned(edited, *WHOLE)) == rules


@pytest.mark.parametrize("edited", ["paper/systems/block.py"], indirect=True)
def test_an_edited_system_does_not_rerun_the_other(edited):
    jobs = planned(edited, *WHOLE)
    assert (jobs["trials"], jobs["sweep"], jobs["reach"], jobs["example"]) == (6, 2, 1, 1)


def test_changed_noise_of_one_system_does_not_rerun_the_other(finished):
    (finished / "noise.yaml").write_text("systems: {block: {noise: 0.123}}")
    jobs = planned(finished, *WHOLE, "noise.yaml")
    assert (jobs["trials"], jobs["sweep"], jobs["reach"], jobs["example"]) == (6, 2, 1, 1)


@pytest.mark.parametrize(
    ("override", "jobs"),
    [
        ("gradients: 3", {"trials": 6, "sweep": 2, "reach": 2, "identifiability": 2}),
        ("sigma: 0.2", {"trials": 4, "sweep": 2, "reach": 2, "identifiability": 2}),
        ("transcription: {iterations: 4}", {"trials": 2, "plans": 2}),
        ("draws: 3", {"trials": 8, "plans": 2, "reach": 2, "identifiability": 2}),  # the sweep has its own
    ],
)
def test_a_key_of_the_design_reruns_the_methods_that_look_at_it(finished, override, jobs):
    overlay = override.startswith("gradients")
    (finished / "design.yaml").write_text(f"design: {{{override}}}" + "\nsweep: {design: {gradients: 3}}" * overlay)
    found = planned(finished, *WHOLE, "design.yaml")
    assert {rule: found.get(rule, 0) for rule in SIMULATED} == {rule: jobs.get(rule, 0) for rule in SIMULATED}


def test_changed_sweep_does_not_rerun_the_trials(finished):
    (finished / "sweep.yaml").write_text("sweep: {surfaces: {arm: [0.5, 0.6, 0.7]}}")
    assert set(planned(finished, *WHOLE, "sweep.yaml")) == {"sweep", "gather", "curve"}


@pytest.mark.parametrize(
    ("stage", "scripts"),
    [
        ("trial", ["trials", "sweep"]),
        ("reach", ["reach", "identifiability"]),
        ("plans", ["plans"]),
        ("forces", ["forces"]),
        ("tables", ["gather"]),
        ("summary", ["summary"]),
        ("figures", ["panels", "ablation", "curve"]),
        ("examples", ["example"]),
    ],
)
def test_the_lists_of_package_files_are_complete(stage, scripts):
    package = ROOT / "src" / "fimpact"
    listed = {package / f"{name}.py" for name in stages()[stage]}
    # Every job of a stage gets the file of its own system; progress only talks; packages but that of the systems are
    # empty; runtime changes nothing where jax is not used; reach imports trial for its random numbers, which imports an
    # estimator it never calls.
    paper, systems = package / "paper", package / "paper" / "systems"
    apart = {package / "support" / "progress.py", paper / "mjx" / "runtime.py", *package.rglob("__init__.py")}
    apart |= set(systems.glob("*.py")) - {systems / "base.py"}
    apart = (apart - {systems / "__init__.py"}) | ({paper / "estimate.py"} if stage in ("reach", "plans") else set())
    found = set().union(*(imported(ROOT / "workflow" / "scripts" / f"{script}.py") for script in scripts))
    assert found - apart == listed - apart


def test_the_main_job_is_the_comparison_alone(fresh):
    assert not planned(fresh, *SMOKE).keys() & {"sweep", "curve"}
