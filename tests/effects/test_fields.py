"""Which field of a simulator an effect is: named for all, true for what MuJoCo writes, and told by page and command."""

from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import pytest
from test_effects import RIGS, placements, scales

from fimpact.cli import main
from fimpact.effects import EFFECTS
from fimpact.effects.fields import FIELDS, NONE, SIMULATORS, fields_of

SLIDER = """<mujoco><worldbody><body name="cart"><joint name="x" type="slide" damping="1"/><geom size=".1" mass="1"/>
<body name="rod"><joint name="turn" axis="0 1 0"/><geom size=".1" pos="0 0 1" mass="1"/></body></body></worldbody>
<actuator><position name="pull" joint="x" kp="5" kv="1"/><motor name="twist" joint="turn"/></actuator>
<sensor><framepos name="seen" objtype="body" objname="rod"/></sensor></mujoco>"""
NOWHERE = {"load_dependent_friction", "dahl", "torque_ripple", "efficiency", "transmission_coupling", "base_gives_way"}
NOWHERE |= {"quadratic_drag", "deadband", "supply_sag"}


def test_every_effect_is_found_in_each_simulator_or_said_to_be_in_none():
    assert set(FIELDS) <= set(EFFECTS)
    for name, effect in EFFECTS.items():
        texts = fields_of(effect)
        assert set(texts) == set(SIMULATORS) and all(texts.values()) and "{" not in "".join(texts.values())
        assert (set(texts.values()) == {NONE}) == (name in NOWHERE), name


def attributes(spec: mujoco.MjSpec) -> dict[tuple[str, int, str], str]:
    """Value of each attribute of an MJCF, by tag, number among the elements of that tag, and name."""
    elements = list(ElementTree.fromstring(spec.to_xml()).iter())
    kinds = {tag: [e for e in elements if e.tag == tag] for tag in (e.tag for e in elements)}
    rows = [(tag, i, e.attrib) for tag, alike in kinds.items() for i, e in enumerate(alike)]
    return {(tag, i, key): value for tag, i, attributes in rows for key, value in attributes.items()}


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.export])
def test_the_mjcf_field_is_what_an_export_writes(name):
    effect = EFFECTS[name]
    for rig, site in placements(effect):
        before, after = (mujoco.MjSpec.from_string(RIGS[rig].xml) for _ in range(2))
        before.compile()
        effect.export(after, site, **effect.probes(scales(rig), RIGS[rig].model(), site)[-1])
        after.compile()
        old, new = attributes(before), attributes(after)
        written = {key for (_, _, key), value in set(new.items()) - set(old.items())}
        named = fields_of(effect)["mjcf"]
        assert any(key in named for key in written), f"{named}: {written}"


def test_usd_counts_hinges_in_degrees_and_slides_in_metres():
    spec = mujoco.MjSpec.from_string(SLIDER)
    spec.compile()
    kp, viscous = EFFECTS["servo_kp"], EFFECTS["viscous"]
    assert "drive:linear:physics:stiffness = kp × (1" in fields_of(kp, spec, "pull")["physx"]
    assert "drive:angular:physics:stiffness = kp × π/180 × (1" in fields_of(kp, spec, "twist")["physx"]
    assert "linear:viscousFrictionCoefficient = damping;" in fields_of(viscous, spec, "x")["physx"]
    assert "angular:viscousFrictionCoefficient = damping × π/180;" in fields_of(viscous, spec, "turn")["physx"]


@pytest.fixture
def cart(tmp_path):
    (tmp_path / "cart.xml").write_text(SLIDER)
    return str(tmp_path / "cart.xml")


def listed(capsys, *arguments: str) -> str:
    assert main(["effects", *arguments]) == 0
    return capsys.readouterr().out


def test_the_command_tells_numbers_units_fields_and_places_of_an_effect(capsys, cart):
    said = " ".join(listed(capsys, "stribeck", "--model", cart).split())
    for text in (
        EFFECTS["stribeck"].sentence, "sign(q̇); at rest", "coefficient speed rad/s, at least",
        "kinds of place Hinge and slide joints", "MJCF none; use improved.py", "URDF none", "in this model x, turn",
        "physxJointAxis:angular:staticFrictionEffort = coulomb + excess", "nothing is per degree",
    ):  # fmt: skip
        assert text in said, text
    assert "in this model" not in listed(capsys, "stribeck")
    assert "nothing is per degree" not in listed(capsys, "sensor_delay")


def test_places_of_a_model_are_those_of_its_sensors_and_of_every_joint(capsys, cart):
    rows = dict(line.split(maxsplit=1) for line in listed(capsys, "--model", cart).splitlines() if line[0] == " ")
    assert rows["servo_kp"] == "pull" and rows["coulomb"] == "x, turn" and rows["ground_tilt"] == "nowhere"
    assert rows["backlash"] == "x, turn" and rows["sensor_bias"] == "seen[0], seen[1], seen[2], x, turn"
    assert set(rows) == set(EFFECTS)


@pytest.mark.parametrize("what", ["gremlin", "coulomb --model nowhere.xml", "coulomb --effects nowhere.py"])
def test_what_is_not_there_gets_one_line(capsys, what):
    assert main(["effects", *what.split()]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_an_effect_of_ones_own_has_no_field(monkeypatch):
    assert set(fields_of(replace(EFFECTS["coulomb"], name="magnet")).values()) == {NONE}
