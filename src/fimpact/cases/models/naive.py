"""The naive MJCF of a case: read whole and unaltered, with the sensors that the log needs and it lacks."""

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from fimpact.cases.errors import CaseError, listed, one_of, summarise_exception
from fimpact.cases.models.compiling import compiled
from fimpact.cases.models.plausible import check_model, check_numbers

FORBIDDEN = "@|+"  # they join names in tables and answers
LARGEST = 16 << 20  # bytes of an MJCF; meshes are files of their own
NAMED = ("joint", "body", "actuator", "sensor", "geom", "site", "pair")


@dataclass(frozen=True)
class Naive:
    """A parsed MJCF: tree of its XML with includes resolved, its folder, and the model compiled from it."""

    path: Path
    tree: ElementTree.Element
    model: mujoco.MjModel

    def names(self, kind: str) -> list[str]:
        """Names of all objects of a kind, such as "joint"."""
        count = getattr(self.model, {"joint": "njnt", "actuator": "nu", "pair": "npair"}.get(kind, f"n{kind}"))
        return [name for i in range(count) if (name := getattr(self.model, kind)(i).name)]

    def text(self) -> str:
        """The XML as it is now."""
        return ElementTree.tostring(self.tree, encoding="unicode")


def read_model(path: Path) -> Naive:
    """Read and compile an MJCF; numbers keep every digit, which `MjSpec.to_xml` would not.

    Raises:
        CaseError: missing, not XML, does not compile, includes a file outside its folder, or has names that
            tables cannot hold.
    """
    tree = _parsed(path, path)
    if tree.tag != "mujoco":
        what = "a URDF" if tree.tag == "robot" else f"<{tree.tag}>"
        raise CaseError(
            f"MJCF {path} is {what}; allowed: <mujoco>; convert it with mujoco.MjSpec.from_file and to_xml, and add "
            "the actuators"
        )
    _include(tree, path, (path.resolve(),))
    _absolute_assets(tree, path.resolve().parent)
    name_free_joints(tree)
    check_numbers(tree, path)
    naive = Naive(path, tree, compiled(tree, path))
    check_model(naive.model, path)
    if naive.model.nhistory or naive.model.npluginstate:
        raise CaseError(
            f"MJCF {path} has a plugin, a delay or an interval with a state of its own, which no log shows; allowed: "
            "models without; leave it out: delays are among what is looked for"
        )
    for kind in NAMED:
        for name in naive.names(kind):
            if set(name) & set(FORBIDDEN):
                raise CaseError(f"MJCF {path}: {kind} '{name}' has one of {' '.join(FORBIDDEN)} in it; rename it")
    return naive


def model_files(path: Path) -> list[Path]:
    """The MJCF, and what it includes or takes meshes and textures from; of one that cannot be read, itself alone."""
    try:
        found = [path]
        tree = _parsed(path, path)
        _include(tree, path, (path.resolve(),), found)
    except CaseError:
        return found
    _absolute_assets(tree, path.resolve().parent)
    return list(dict.fromkeys(found + _assets(tree)))


def _assets(tree: ElementTree.Element) -> list[Path]:
    folders = {"mesh": "meshdir", "hfield": "meshdir", "skin": "meshdir", "texture": "texturedir", "model": ""}
    given = {key: value for compiler in tree.iter("compiler") for key, value in compiler.attrib.items()}
    found = [
        Path(given.get(folder, ".")) / asset.get("file", "")
        for tag, folder in folders.items()
        for asset in tree.iter(tag)
        if asset.get("file")
    ]
    return [file for file in found if file.is_file()]


def _parsed(path: Path, main: Path) -> ElementTree.Element:
    what = "" if path == main else f" (included by {main})"
    if not path.is_file():
        raise CaseError(f"MJCF {path}{what} does not exist; correct the path")
    if path.stat().st_size > LARGEST:
        raise CaseError(
            f"MJCF {path}{what} has {path.stat().st_size >> 20} MB; allowed: {LARGEST >> 20} MB; shorten it"
        )
    try:
        text = path.read_text(encoding="utf-8")
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise CaseError(f"MJCF {path}{what} declares entities; allowed: plain XML; remove the declaration")
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise CaseError(f"MJCF {path}{what} is not XML: {summarise_exception(error)}; correct it") from None


def _include(tree: ElementTree.Element, main: Path, seen: tuple[Path, ...], found: list[Path] | None = None) -> None:
    for parent in list(tree.iter()):
        for position, child in reversed(list(enumerate(parent))):
            if child.tag == "include":
                parent[position : position + 1] = list(_included(child.get("file", ""), main, seen, found))


def _included(file: str, main: Path, seen: tuple[Path, ...], found: list[Path] | None) -> ElementTree.Element:
    path = _inside(file, main.resolve().parent)
    if path in seen:
        raise CaseError(f"MJCF {main} includes '{file}' again from within itself; remove one of the includes")
    tree = _parsed(path, main) if path.is_file() else _parsed(main.parent / file, main)
    if found is not None:
        found.append(path)
    _include(tree, main, (*seen, path), found)
    return tree


def _inside(file: str, folder: Path) -> Path:
    path = (folder / file).resolve()
    if not path.is_relative_to(folder):
        raise CaseError(
            f"an MJCF in {folder} includes '{file}', which leaves its folder; allowed: files inside it; copy it there"
        )
    return path


def _absolute_assets(tree: ElementTree.Element, folder: Path) -> None:
    # A recording is compiled from a string, which has no folder to look for meshes in.
    for attached in tree.iterfind("asset/model"):
        attached.set("file", str(_inside(attached.get("file", ""), folder)))
    if not any(asset.get("file") for asset in tree.iter() if asset.tag != "include"):
        return
    given = {key: value for compiler in tree.iter("compiler") for key, value in compiler.attrib.items()}
    both = given.get("assetdir", ".")
    dirs = {key: str(folder / given.get(key, both)) for key in ("meshdir", "texturedir")}
    ElementTree.SubElement(tree, "compiler", dirs)


def name_free_joints(tree: ElementTree.Element) -> None:
    """Name each free joint that has no name after its body.

    Which body is free needs no name in an MJCF; starts, states and effects are told apart by the joint's.
    """
    taken = {joint.get("name") for tag in ("joint", "freejoint") for joint in tree.iter(tag)}
    for number, body in enumerate(tree.iter("body"), 1):
        name = f"{body.get('name') or f'body {number}'} free"
        for joint in body:
            free = joint.tag == "freejoint" or (joint.tag == "joint" and joint.get("type") == "free")
            if free and not joint.get("name") and name not in taken:
                joint.set("name", name)


def joint_of(naive: Naive, name: str, where: str) -> tuple[str, int]:
    """Name and type of a joint."""
    one_of(naive.names("joint"), name, "joint", where)
    return name, int(naive.model.joint(name).type[0])


def body_element(naive: Naive, name: str, where: str) -> ElementTree.Element:
    """The XML element of a body, to which a site can be added.

    Raises:
        CaseError: no such body, or one that MuJoCo makes by replication or attachment.
    """
    one_of(naive.names("body"), name, "body", where)
    for element in naive.tree.iter("body"):
        if element.get("name") == name:
            return element
    bodies = [element.get("name", "") for element in naive.tree.iter("body")]
    raise CaseError(
        f"{where}: body '{name}' is made by MuJoCo from another; {listed(bodies, name)}; give it a site in the MJCF"
    )
