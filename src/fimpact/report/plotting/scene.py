"""What there is to see of a motion: MuJoCo C's poses, contact forces and measurements in the plane of motion.

Nothing here knows a robot: outlines come from the geoms of the compiled model.
"""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

CIRCLE = np.stack([np.cos(angle := np.linspace(0, 2 * np.pi, 48, endpoint=False)), np.sin(angle)], 1)
ROUND = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE)
SIGNS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T


@dataclass(frozen=True)
class Scene:
    """One experiment, step by step.

    `position` (T, ngeom, 3) and `rotation` (T, ngeom, 3, 3) place the geoms; `contacts` holds per step an array
    (n, 2, 2) of point (m) and force on the moving body (N) in the plane; `measurement` (T, ny) is without noise;
    `pivots` (n, 2) are the joints that hold the robot to the world.
    """

    model: mujoco.MjModel
    axes: tuple[int, int]
    time: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    contacts: tuple[np.ndarray, ...]
    measurement: np.ndarray
    pivots: np.ndarray

    @cached_property
    def cores(self) -> list[tuple[np.ndarray, float]]:
        """Of each geom, points (n, 3) in its frame and a radius, m, to round them by: the hull of both is the geom."""
        return [_core(self.model, geom) for geom in range(self.model.ngeom)]

    @property
    def force(self) -> np.ndarray:
        """Magnitude of the strongest contact force at every step, shape (T,), N."""
        return np.array([np.linalg.norm(step[:, 1], axis=1).max(initial=0.0) for step in self.contacts])

    @property
    def touching(self) -> np.ndarray:
        """Whether there is contact at every step, shape (T,)."""
        return np.array([len(step) > 0 for step in self.contacts])

    @property
    def episodes(self) -> np.ndarray:
        """First step of every contact and the step after its last, shape (n, 2)."""
        return np.flatnonzero(np.diff(np.r_[False, self.touching, False])).reshape(-1, 2)


def plane_of_motion(model: mujoco.MjModel) -> tuple[int, int]:
    """World axes of the picture: seen from above without gravity, from the side with it."""
    return (0, 2) if model.opt.gravity.any() else (0, 1)


def contacts(model: mujoco.MjModel, data: mujoco.MjData, axes: tuple[int, int]) -> np.ndarray:
    """Point and force on the moving body of every contact, shape (n, 2, 2), in the plane of `axes`."""
    found = np.zeros((data.ncon, 2, 3))
    for index, contact in enumerate(data.contact):
        wrench = np.zeros(6)
        mujoco.mj_contactForce(model, data, index, wrench)
        force = contact.frame.reshape(3, 3).T @ wrench[:3]
        # MuJoCo gives the force on the second geom.
        found[index] = contact.pos, force if moves(model, contact.geom2) else -force
    return found[:, :, list(axes)]


def pivots(model: mujoco.MjModel, data: mujoco.MjData, axes: tuple[int, int]) -> np.ndarray:
    """Where bodies hang on the world by one hinge, shape (n, 2)."""
    held = (model.body_parentid == 0) & (model.body_jntnum == 1)
    hinges = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    return np.array([data.xanchor[j, list(axes)] for j in hinges if held[model.jnt_bodyid[j]]]).reshape(-1, 2)


def moves(model: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom belongs to a body that a joint carries."""
    return model.body_weldid[model.geom_bodyid[geom]] != 0


def outline(scene: Scene, geom: int, step: int) -> np.ndarray:
    """Silhouette of a geom at a step: a convex polygon (n, 2) in the plane of motion; empty for planes and fields."""
    core, radius = scene.cores[geom]
    if not len(core):
        return np.zeros((0, 2))
    points = core @ scene.rotation[step, geom].T + scene.position[step, geom]
    cloud = points[:, list(scene.axes)]
    if radius:
        cloud = (cloud[:, None] + radius * CIRCLE).reshape(-1, 2)
    try:
        return cloud[ConvexHull(cloud).vertices]
    except QhullError:  # seen edge on: its two ends
        along = (cloud - cloud.mean(0)) @ np.linalg.svd(cloud - cloud.mean(0), full_matrices=False)[2][0]
        return cloud[[along.argmin(), along.argmax()]]


def surfaces(scene: Scene) -> list[tuple[np.ndarray, np.ndarray]]:
    """Point and outward normal, (2,) each, of every fixed plane that is seen edge on."""
    model, axes = scene.model, list(scene.axes)
    planes = [g for g in range(model.ngeom) if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE]
    normals = {g: scene.rotation[0, g, axes, 2] for g in planes}
    return [(scene.position[0, g, axes], n / np.linalg.norm(n)) for g, n in normals.items() if np.linalg.norm(n) > 0.1]


def _core(model: mujoco.MjModel, geom: int) -> tuple[np.ndarray, float]:
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        first, count = model.mesh_vertadr[model.geom_dataid[geom]], model.mesh_vertnum[model.geom_dataid[geom]]
        return _corners(model.mesh_vert[first : first + count]), 0.0
    return _CORES.get(kind, lambda size: np.zeros((0, 3)))(size), size[0] if kind in ROUND else 0.0


def _corners(points: np.ndarray) -> np.ndarray:
    """Those of `points`, (n, 3), that span their hull; all, where they are flat."""
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        return points


def _cylinder(size: np.ndarray) -> np.ndarray:
    return np.concatenate([np.c_[size[0] * CIRCLE, np.full(len(CIRCLE), end)] for end in (-size[1], size[1])])


def _ellipsoid(size: np.ndarray) -> np.ndarray:
    height = np.linspace(-1, 1, 33)
    ring = np.sqrt(1 - height**2)[:, None, None] * CIRCLE
    return np.concatenate([ring, np.broadcast_to(height[:, None, None], (*ring.shape[:2], 1))], 2).reshape(-1, 3) * size


_CORES = {
    mujoco.mjtGeom.mjGEOM_SPHERE: lambda size: np.zeros((1, 3)),
    mujoco.mjtGeom.mjGEOM_CAPSULE: lambda size: np.array([[0, 0, -size[1]], [0, 0, size[1]]]),
    mujoco.mjtGeom.mjGEOM_BOX: lambda size: SIGNS * size,
    mujoco.mjtGeom.mjGEOM_CYLINDER: _cylinder,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: _ellipsoid,
}
