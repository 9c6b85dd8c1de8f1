"""An MJCF may hold anything: what no robot has is refused in a line, before it costs memory, time or a crash."""

import struct

import pytest
from bad_input import MODEL, check_refusal, state, write

from fimpact.cases.models import compiling
from fimpact.cli import main


def spoilt(old: str, new: str) -> str:
    """The good MJCF with one part replaced."""
    assert MODEL.count(old) == 1
    return MODEL.replace(old, new)


def option(attributes: str) -> str:
    return spoilt('timestep="0.005"', f'timestep="0.005" {attributes}')


def joint(attributes: str) -> str:
    return spoilt('axis="0 1 0" damping="0.02"', f'axis="0 1 0" {attributes}')


def world(xml: str, before: str = "") -> str:
    return spoilt("<worldbody>", f"{before}<worldbody>{xml}")


def asset(xml: str) -> str:
    return world("", f"<asset>{xml}</asset>")


def stl(faces: int, told: int | None = None, corner: float = 0.1) -> bytes:
    """A binary STL."""
    face = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, corner, 0, 0, 0, corner, 0, 0)
    return b"\0" * 80 + struct.pack("<I", faces if told is None else told) + face * faces


MESH = world('<geom type="mesh" mesh="m" mass="0.1"/>', '<asset><mesh name="m" file="m.stl"/></asset>')
PNG = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">II", 60000, 60000) + b"\x08\x02\0\0\0"
DEEP = '<body><geom size="0.1"/>' * 5000 + "</body>" * 5000
GRID = '<replicate count="2000" offset="0 0 1"><replicate count="2000" offset="0 1 0"><site/></replicate></replicate>'
CLOTH = '<flexcomp name="cloth" type="grid" count="2000 2000 1" spacing="1 1 1" mass="1" radius="0.1"/>'
BAD = [  # what is wrong, the MJCF, a word of the refusal, other files
    ("empty", "", "not XML", {}),
    ("blanks", "  \n ", "not XML", {}),
    ("zeros", "\0" * 1000, "not XML", {}),
    ("cut off", MODEL[:200], "not XML", {}),
    ("html", "<html><body>404</body></html>", "<html>", {}),
    ("picture", PNG * 20, "not XML", {}),
    ("name with a bell", joint('name="a&#7;"').replace('name="shoulder" ', ""), "not XML", {}),
    ("mass nan", spoilt('mass="0.6"', 'mass="nan"'), "mass", {}),
    ("mass -nan", spoilt('mass="0.6"', 'mass="-NaN"'), "mass", {}),
    ("mass 1e300", spoilt('mass="0.6"', 'mass="1e300"'), "mass", {}),
    ("mass negative", spoilt('mass="0.6"', 'mass="-1"'), "mass", {}),
    ("mass inf", spoilt('mass="0.6"', 'mass="inf"'), "mass", {}),
    ("size nan", spoilt('size="0.02"', 'size="nan"'), "size", {}),
    ("size inf", spoilt('size="0.02"', 'size="inf"'), "arm.xml", {}),
    ("armature negative", joint('armature="-1"'), "armature", {}),
    ("armature nan", joint('armature="nan"'), "armature", {}),
    ("friction negative", joint('frictionloss="-0.1"'), "frictionloss", {}),
    ("damping inf", joint('damping="inf"'), "damping", {}),
    ("stiffness inf", joint('stiffness="inf"'), "stiffness", {}),
    ("axis nan", spoilt('axis="0 1 0"', 'axis="nan 1 0"'), "axis", {}),
    ("axis zero", spoilt('axis="0 1 0"', 'axis="0 0 0"'), "axis", {}),
    ("range nan", joint('range="-1 nan"'), "range", {}),
    ("gear nan", spoilt('joint="shoulder"/>', 'joint="shoulder" gear="nan"/>'), "gear", {}),
    ("gear inf", spoilt('joint="shoulder"/>', 'joint="shoulder" gear="inf"/>'), "gear", {}),
    ("kp inf", spoilt("<motor ", '<position kp="inf" '), "drive", {}),
    ("timestep text", spoilt('"0.005"', '"fast"'), "timestep", {}),
    ("timestep nan", spoilt('"0.005"', '"nan"'), "timestep", {}),
    ("timestep inf", spoilt('"0.005"', '"inf"'), "timestep", {}),
    ("timestep in ms", spoilt('"0.005"', '"5"'), "timestep", {}),
    ("gravity two numbers", option('gravity="0 -9.81"'), "gravity", {}),
    ("gravity in mm", option('gravity="0 0 -9810"'), "gravity", {}),
    ("wind inf", option('wind="inf 0 0"'), "wind", {}),
    ("density negative", option('density="-1"'), "density", {}),
    ("viscosity nan", option('viscosity="nan"'), "viscosity", {}),
    ("viscosity inf", option('viscosity="inf"'), "viscosity", {}),
    ("solver for ever", option('iterations="2000000000" tolerance="0"'), "iterations", {}),
    ("integrator unknown", option('integrator="magic"'), "magic", {}),
    ("memory", world("", '<size memory="900G"/>'), "memory", {}),
    ("joint twice", world('<body><joint name="shoulder"/><geom size="1"/></body>'), "shoulder", {}),
    ("actuator nowhere", spoilt('joint="shoulder"/>', 'joint="elbow"/>'), "elbow", {}),
    ("element unknown", world("<robot/>"), "robot", {}),
    ("attribute unknown", joint('dampening="1"'), "dampening", {}),
    ("deep", world(DEEP), "inside one another", {}),
    ("long", world("<!-- " + "x" * (17 << 20) + " -->"), "MB", {}),
    ("mesh missing", MESH, "m.stl", {}),
    ("mesh cut off", MESH, "m.stl", {"m.stl": stl(3)[:-30]}),
    ("mesh told larger", MESH, "m", {"m.stl": stl(1, 100_000_000)}),
    ("mesh empty", MESH, "m", {"m.stl": b""}),
    ("mesh of nan", MESH, "m", {"m.stl": stl(4, corner=float("nan"))}),
    ("mesh flat", MESH, "m", {"m.stl": stl(4)}),
    ("mesh is a folder", MESH, "m", {"m.stl/x": ""}),
    ("mesh of no points", MESH.replace("m.stl", "m.obj"), "m", {"m.obj": "# nothing\n"}),
    ("mesh of one point", MESH.replace("m.stl", "m.obj"), "m", {"m.obj": "v 0 0 0\nf 1 1 1\n"}),
    ("picture 60000", asset('<texture name="t" type="2d" file="t.png"/>'), "t", {"t.png": PNG}),
    ("picture cut off", asset('<texture name="t" type="2d" file="t.png"/>'), "t", {"t.png": PNG[:10]}),
    ("height field of nothing", asset('<hfield name="h" nrow="0" ncol="0" size="1 1 1 1"/>'), "arm.xml", {}),
    ("height field negative", asset('<hfield name="h" nrow="-5" ncol="5" size="1 1 1 1"/>'), "arm.xml", {}),
    ("include missing", world('<include file="more.xml"/>'), "more.xml", {}),
    ("include of a folder", world('<include file="logs"/>'), "logs", {"logs/x": ""}),
    ("include of a log", world('<include file="monday.csv"/>'), "monday.csv", {}),
    ("include without a file", world("<include/>"), "arm.xml", {}),
    ("include in a circle", world('<include file="b.xml"/>'), "again", {"b.xml": '<m><include file="b.xml"/></m>'}),
    ("laughs", '<!DOCTYPE m [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>' + MODEL, "entities", {}),
]
LINK = '<joint kind="main"/><geom type="capsule" size=".01"/>'
ROPE = f'<composite type="cable" count="9000 1 1" curve="s" size="900">{LINK}</composite>'
HEAVY = [  # refused after a child has tried, in seconds
    ("replicate in replicate", world(GRID), "replicate"),
    ("cloth", world(CLOTH), "flexcomp 'cloth'"),
    ("rope", world(ROPE), "composite with count 9000"),
    ("texture", asset('<texture name="sky" type="skybox" builtin="flat" width="30000" height="30000"/>'), "sky"),
]


@pytest.mark.parametrize(("model", "word", "files"), [own[1:] for own in BAD], ids=[own[0] for own in BAD])
def test_what_no_robot_has_is_refused(model, word, files, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, model=model, files=files)
    before = state(tmp_path)
    code = main(["check", "case.yaml"])
    check_refusal(code, *capfd.readouterr(), word)
    assert state(tmp_path) == before


@pytest.mark.parametrize(("model", "word"), [own[1:] for own in HEAVY], ids=[own[0] for own in HEAVY])
def test_what_takes_too_much_is_refused_by_its_name(model, word, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(compiling, "SECONDS", 2)
    write(tmp_path, model=model)
    check_refusal(main(["check", "case.yaml"]), *capfd.readouterr(), word)


def test_what_is_large_but_compiles_is_taken(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    many = '<replicate count="6000" offset="0 0 1"><site/></replicate>'
    tried = []
    monkeypatch.setattr(compiling, "try_in_child", lambda *found: tried.append(found[-1]))
    write(tmp_path, model=world(many))
    assert main(["check", "case.yaml"]) == 0, capfd.readouterr().err
    assert "replicate" in tried[0] and not (tmp_path / "MUJOCO_LOG.TXT").exists()
