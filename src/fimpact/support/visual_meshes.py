"""Meshes that are only seen: they take most of the time and memory of many a robot's model, and move nothing."""

from pathlib import Path

import mujoco

MESH = mujoco.mjtGeom.mjGEOM_MESH
FROM_GEOMS = 1  # of the compiler's inertiafromgeom: what the MJCF says of inertia is overruled
LOOKS = mujoco.mjtSensor.mjSENS_RANGEFINDER  # its ray ends at what is seen


def without_visuals(spec: mujoco.MjSpec, apart: bool = False) -> mujoco.MjSpec:
    """Remove from `spec` the meshes that nothing touches, names or weighs, of bodies that have another shape, or stand
    still; what is compiled of it moves as before.

    Args:
        apart: nothing touches anything: no mesh is needed, and of each model less is copied.
    """
    if spec.compiler.inertiafromgeom == FROM_GEOMS or any(sensor.type == LOOKS for sensor in spec.sensors):
        return spec
    if apart:
        spec.stat.extent = without_visuals(spec.copy()).compile().stat.extent
    for body in spec.bodies:
        geoms = list(body.geoms)
        seen = [geom for geom in geoms if _only_seen(geom, apart)] if body.explicitinertial else []
        if apart or len(seen) < len(geoms) or _stands(body):
            for geom in seen:
                spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    for mesh in [mesh for mesh in spec.meshes if (mesh.name or Path(mesh.file).stem) not in used]:
        spec.delete(mesh)
    return spec


def _stands(body) -> bool:
    while body is not None and not body.joints:
        body = body.parent
    return body is None


def _only_seen(geom, apart: bool) -> bool:
    touches = (geom.contype or geom.conaffinity) and not apart
    return geom.type == MESH and not touches and not geom.name and not geom.fluid_ellipsoid
