"""Every bad configuration gets one line that names the key, the value, and what is allowed."""

from copy import deepcopy
from pathlib import Path

import pytest
import yaml
from conftest import ROOT

from fimpact.paper import config as checker
from fimpact.paper.config import check

SCHEMA = ROOT / "workflow" / "schemas" / "config.schema.yaml"


def merged(base: dict, override: dict) -> dict:
    """What `--configfile` does: tables merge, all else is replaced."""
    result = deepcopy(base)
    for key, value in override.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        result[key] = merged(base[key], value) if both else value
    return result


@pytest.fixture
def paper() -> dict:
    return yaml.safe_load((ROOT / "config" / "config.yaml").read_text())


@pytest.mark.parametrize("name", ["config", "smoke", "reference", "ablation"])
def test_shipped_configurations_are_valid(paper, name):
    shipped = yaml.safe_load((ROOT / "config" / f"{name}.yaml").read_text())
    shipped.pop("concealed", None)  # has a schema of its own
    check(merged(paper, shipped), SCHEMA)


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("raunds: 3", ["raunds is not a key", "sweep, reach", "did you mean 'rounds'?"]),
        ("systems: {arm: {contact: {timecnst: 1}}}", ["systems.arm.contact.timecnst", "did you mean 'timeconst'?"]),
        ("systems: {arm: {noise: -0.1}}", ["systems.arm.noise is -0.1", "greater than 0"]),
        ("systems: {arm: {noise: 1e-3}}", ["systems.arm.noise is '1e-3'", "a number: write 0.001"]),
        ("systems: {arm: {noise: .nan}}", ["systems.arm.noise is nan", "finite"]),
        ("select: {systems: [amr]}", ["select.systems[0] is 'amr'", "allowed: arm, block", "'arm'?"]),
        ("systems: {leg: {noise: 1}}", ["systems.leg is not known", "allowed: arm, block"]),
        ("select: {methods: [fihser]}", ["select.methods[0] is 'fihser'", "multisine", "did you mean 'fisher'?"]),
        ("select: {first: {uniform: 3}}", ["select.first has uniform", "on all seeds; remove it"]),
        ("select: {first: {uniforn: 3}}", ["select.first.uniforn is not", "did you mean 'uniform'?"]),
        ("select: {methods: [fisher]}", ["select.methods lacks uniform", "add it"]),
        ("sweep: {methods: [uniform]}", ["sweep.methods lacks fisher", "add it"]),
        (
            "systems: {block: {spread: 0.7}}",
            ["systems.block.spread is 0.7", "mass is drawn from 0.15 to 0.85", "make it smaller"],
        ),
        ("design: {criterion: F}", ["design.criterion is 'F'", "allowed: trace, A, D, E"]),
        ("systems: {block: {parameters: {mass: {bounds: [0.8, 0.2]}}}}", ["mass.bounds is [0.8, 0.2]", "swap them"]),
        ("systems: {block: {parameters: {mass: {nominal: 3}}}}", ["mass.nominal is 3", "its bounds 0.2 and 0.8"]),
        ("systems: {block: {parameters: {mass: {bounds: [-1, 1]}}}}", ["mass.bounds[0] is -1", "greater than 0"]),
        ("systems: {block: {inputs: {spin: [3, 1]}}}", ["systems.block.inputs.spin is [3, 1]", "swap them"]),
        ("systems: {block: {inputs: {spin: 3}}}", ["systems.block.inputs.spin is 3", "a pair [low, high]"]),
        ("select: {seeds: []}", ["select.seeds is []", "at least one entry"]),
        ("select: {seeds: [1, 2, 1]}", ["select.seeds is [1, 2, 1]", "nothing is repeated"]),
        ("rounds: 0", ["rounds is 0", "at least 1"]),
        ("rounds: 2.5", ["rounds is 2.5", "a whole number"]),
        ("results: out/", ["results is 'out/'", "without a slash at its end"]),
        ("design: {sigma: 1.5}", ["design.sigma is 1.5", "at most 1"]),
        ("sweep: {design: {generations: 0}}", ["sweep.design.generations is 0", "at least"]),
        ("sweep: {surfaces: {leg: [1]}}", ["sweep.surfaces.leg", "allowed: arm, block"]),
        ("estimate: null", ["estimate is None", "a table"]),
    ],
)
def test_a_mistake_gets_one_clear_line(paper, override, parts):
    with pytest.raises(ValueError, match=r"^configuration: ") as error:
        check(merged(paper, yaml.safe_load(override)), SCHEMA)
    assert "\n" not in str(error.value)
    for part in parts:
        assert part in str(error.value)


def test_a_missing_key_is_named(paper):
    del paper["systems"]["arm"]["steps"]
    with pytest.raises(ValueError, match=r"systems\.arm\.steps is missing"):
        check(paper, SCHEMA)


def test_a_swept_system_needs_surfaces(paper):
    del paper["sweep"]["surfaces"]["block"]
    with pytest.raises(ValueError, match=r"sweep\.surfaces\.block is missing"):
        check(paper, SCHEMA)


@pytest.fixture
def models(tmp_path, monkeypatch) -> Path:
    for path in checker.MJCF.glob("*.xml"):
        (tmp_path / path.name).write_text(path.read_text())
    monkeypatch.setattr(checker, "MJCF", tmp_path)
    return tmp_path


def test_an_mjcf_that_does_not_parse_is_named(paper, models):
    (models / "arm.xml").write_text("<mujoco><worldbody><bdy/></worldbody></mujoco>")
    with pytest.raises(ValueError, match=r"systems\.arm has an MJCF that does not parse; .*arm\.xml: ") as error:
        check(paper, SCHEMA)
    assert "\n" not in str(error.value)


def test_a_system_of_ones_own_is_allowed(paper, models):
    (models / "leg.xml").write_text("<mujoco/>")
    own = {"knee": {"unit": "m", "nominal": 1.0, "bounds": [-2.0, 2.0]}}
    leg = {**paper["systems"]["arm"], "contact": {"stiffness": 1.0}, "inputs": {"push": [0, 1]}, "parameters": own}
    override = {"systems": {"leg": leg}, "select": {"systems": ["leg"]}, "sweep": {"surfaces": {"leg": [0.1]}}}
    check(merged(paper, override), SCHEMA)


def test_contact_is_tightened_and_never_relaxed(paper):
    with pytest.raises(ValueError, match=r"design\.transcription\.eps is \[0\.1, 0\.1\]; each must be less"):
        check(merged(paper, {"design": {"transcription": {"eps": [0.1, 0.1]}}}), SCHEMA)


def test_the_schema_knows_what_the_package_offers():
    # The schema repeats these names because reading them from the package would import jax at every `snakemake`.
    from fimpact.paper.contact_implicit.bodies import PLANAR
    from fimpact.paper.design import METHODS
    from fimpact.paper.information.fisher import CRITERIA
    from fimpact.paper.systems import SYSTEMS

    names = yaml.safe_load(SCHEMA.read_text())["$defs"]
    assert set(names["methods"]["items"]["enum"]) == set(METHODS)
    assert set(names["design"]["properties"]["criterion"]["enum"]) == set(CRITERIA)
    assert {path.stem for path in checker.MJCF.glob("*.xml")} == set(SYSTEMS)
    assert set(checker.PLANAR) == set(PLANAR)
    assert set(checker.SEEN) == set(METHODS)
    assert set().union(*checker.SEEN.values()) == set(names["design"]["properties"])


def test_numbers_inside_braces_on_the_command_line_are_numbers(paper):
    """Of ``--config 'design={generations: 3}'`` snakemake makes text."""
    given = merged(paper, {"rounds": "2", "design": {"sigma": "0.5"}})
    check(given, SCHEMA)
    assert (given["rounds"], given["design"]["sigma"]) == (2, 0.5)
