"""What is only seen is left out of what is simulated, and nothing else is."""

import struct

import mujoco
import numpy as np
import pytest

from fimpact.support.visual_meshes import without_visuals

CORNERS = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
INERTIAL = '<inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.01"/>'
SEEN = '<geom type="mesh" mesh="m" contype="0" conaffinity="0"/>'
HARD = '<geom size="0.05" pos="0.1 0 0"/>'


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    """A tetrahedron as a binary STL."""
    path = tmp_path_factory.mktemp("mesh") / "m.stl"
    faces = b"".join(struct.pack("<12fH", 0, 0, 0, *CORNERS[list(face)].ravel(), 0) for face in FACES)
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(FACES)) + faces)
    return path


def spec(mesh, inside: str, more: str = "", compiler: str = "") -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(
        f'<mujoco><compiler {compiler}/><asset><mesh file="{mesh}"/></asset><worldbody><body name="arm">'
        f'<joint axis="0 1 0"/>{inside}</body><site name="eye" zaxis="0 0 1"/></worldbody>{more}</mujoco>'
    )


def test_what_is_only_seen_is_left_out_and_all_moves_as_before(mesh):
    whole, lean = spec(mesh, INERTIAL + SEEN + HARD).compile(), without_visuals(spec(mesh, INERTIAL + SEEN + HARD))
    lean = lean.compile()
    assert (whole.ngeom, whole.nmesh, lean.ngeom, lean.nmesh) == (2, 1, 1, 0)
    both = [mujoco.MjData(whole), mujoco.MjData(lean)]
    for model, data in zip((whole, lean), both, strict=True):
        data.qpos[:] = 0.7
        mujoco.mj_forward(model, data)
    assert both[0].qacc == both[1].qacc and both[0].qacc.any()


@pytest.mark.parametrize(
    ("inside", "more", "compiler"),
    [
        (SEEN + HARD, "", ""),  # it weighs
        (INERTIAL + SEEN + HARD, "", 'inertiafromgeom="true"'),
        (INERTIAL + SEEN, "", ""),  # the film would show nothing
        (INERTIAL + SEEN.replace("<geom", '<geom name="shell"') + HARD, "", ""),  # somebody may ask for it
        (INERTIAL + '<geom type="mesh" mesh="m"/>' + HARD, "", ""),  # it touches
        (INERTIAL + SEEN + HARD, '<sensor><rangefinder site="eye"/></sensor>', ""),  # a sensor sees it
    ],
)
def test_what_may_matter_stays(mesh, inside, more, compiler):
    whole, lean = spec(mesh, inside, more, compiler), without_visuals(spec(mesh, inside, more, compiler))
    assert len(lean.geoms) == len(whole.geoms) and len(lean.meshes) == 1


def test_a_base_that_stands_still_needs_no_looks(mesh):
    xml = f'<mujoco><asset><mesh file="{mesh}"/></asset><worldbody><body>{INERTIAL}{SEEN}</body></worldbody></mujoco>'
    assert not without_visuals(mujoco.MjSpec.from_string(xml)).geoms


def test_where_nothing_touches_no_mesh_is_needed(mesh):
    inside = INERTIAL + '<geom type="mesh" mesh="m"/>'
    whole, lean = spec(mesh, inside).compile(), without_visuals(spec(mesh, inside), apart=True).compile()
    assert (whole.nmesh, lean.nmesh, lean.ngeom) == (1, 0, 0)
    assert lean.stat.extent == whole.stat.extent and lean.body_mass.tolist() == whole.body_mass.tolist()
