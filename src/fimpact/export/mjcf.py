"""The text of an exported MJCF: numbers with all their digits, and beside it the files that it loads."""

import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

ASSETS = "assets"
EXPORTED_FIELDS = (
    "body_",
    "dof_",
    "jnt_",
    "geom_",
    "site_",
    "actuator_",
    "pair_",
    "eq_",
    "tendon_",
    "qpos",
    "cam_",
    "mesh_",
)


def exact(xml: str, model: mujoco.MjModel) -> dict[str, str]:
    """Numbers of the naive MJCF and of the compiled model by the six digits that MuJoCo writes of them."""
    numbers = [float(n) for e in ElementTree.fromstring(xml).iter() for v in e.attrib.values() for n in _numbers(v)]
    arrays = [getattr(model, name) for name in dir(model) if name.startswith(EXPORTED_FIELDS)]
    arrays += [getattr(model.opt, name) for name in ("timestep", "gravity", "wind", "density", "viscosity")]
    for array in arrays:
        if isinstance(array, float) or getattr(array, "dtype", None) == np.float64:
            numbers += np.ravel(array).tolist()
    return {f"{number:.6g}": repr(number) for number in numbers}


def _numbers(value: str) -> list[str]:
    return [token for token in value.split() if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", token, re.I)]


def restore_full_precision(tree: ElementTree.Element, exact: dict[str, str]) -> None:
    """Put the `exact` numbers in the place of their six digits, which a long or chaotic simulation can tell from the
    fit."""
    for element in tree.iter():
        for key, value in element.attrib.items():
            tokens = value.split()
            if key != "name" and tokens == _numbers(value):
                element.set(key, " ".join(t if t.lstrip("-").isdigit() else exact.get(t, t) for t in tokens))


def carry_assets(tree: ElementTree.Element, source: Path, folder: Path) -> list[Path]:
    """Copy meshes, textures and height fields beside the model, and name them there."""
    dirs = {k: v for c in tree.iter("compiler") for k, v in c.attrib.items() if k in ("meshdir", "texturedir")}
    copies: dict[Path, Path] = {}
    for element in (e for a in tree.iter("asset") for e in a.iter()):
        root = source / dirs.get("texturedir" if element.tag == "texture" else "meshdir", "")
        for key in [k for k in element.attrib if k.startswith("file")]:
            origin = root / element.attrib[key]
            taken = {p.name for o, p in copies.items() if o != origin}
            inside = Path(ASSETS) if origin.name not in taken else Path(ASSETS) / str(len(copies))
            copies.setdefault(origin, inside / origin.name)
            element.set(key, copies[origin].as_posix())
    for compiler in tree.iter("compiler"):
        for key in dirs:
            compiler.attrib.pop(key, None)
    for origin, place in copies.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(origin, folder / place)
    return [folder / place for place in copies.values()]
