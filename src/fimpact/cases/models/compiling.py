"""Compiling an MJCF that may ask for anything: MuJoCo would take all the memory, or hours, or fall over.

What is plainly small is compiled here. Anything else is tried first in a child with limits of time and memory.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from math import prod
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from fimpact.cases.errors import CaseError, summarise_exception
from fimpact.support.mujoco_setup import hush
from fimpact.support.visual_meshes import without_visuals

DEEP = 100  # elements inside one another; MuJoCo allows hardly more
FEW, SMALL = 5_000, 64 << 20  # elements, and bytes of meshes and pictures, which MuJoCo compiles in a second or two
SECONDS, MEMORY = 10, 4 << 30  # of a child, s and bytes
COUNTS = {"replicate": "count", "composite": "count", "flexcomp": "count"}  # what is made so many times
SIDES = {"texture": 6, "hfield": 1}  # a texture may be a cube
CHILD = f"""
import sys
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, ({MEMORY}, {MEMORY}))
    resource.setrlimit(resource.RLIMIT_CPU, ({SECONDS}, {SECONDS}))
except (ImportError, ValueError):
    pass
import mujoco
mujoco.set_mju_user_warning(lambda message: None)
try:
    mujoco.MjSpec.from_string(sys.stdin.buffer.read().decode()).compile()
except ValueError as error:
    sys.exit(str(error))
"""

hush()  # a model with NaN would leave MUJOCO_LOG.TXT


def compiled(tree: ElementTree.Element, path: Path) -> mujoco.MjModel:
    """The model of a tree.

    Raises:
        CaseError: MuJoCo does not accept it, or it takes more time or memory than a robot does.
    """
    if _depth(tree) > DEEP:
        raise CaseError(
            f"MJCF {path} has more than {DEEP} elements inside one another; allowed: fewer; make it flatter"
        )
    xml = ElementTree.tostring(tree, encoding="unicode")
    parts = sorted(_parts(tree), reverse=True)
    if sum(size for size, _ in parts) > 1.0:
        try_in_child(xml, path, parts[0][1])
    try:
        return without_visuals(mujoco.MjSpec.from_string(xml)).compile()
    except Exception as error:
        raise CaseError(f"MJCF {path} does not compile: {summarise_exception(error)}; correct it") from None


def _depth(tree: ElementTree.Element) -> int:
    level, depth = [tree], 0
    while level and depth <= DEEP:
        level, depth = [child for element in level for child in element], depth + 1
    return depth


def _parts(tree: ElementTree.Element) -> Iterator[tuple[float, str]]:
    """How much of what is small each part takes, and what it is; in all it is not small beyond 1."""
    yield from _made(tree, 1)
    for element in tree.iter():
        for width, height in (("nrow", "ncol"), ("width", "height")):
            size = _number(element, width) * _number(element, height) * 4 * SIDES.get(element.tag, 0)
            yield size / SMALL, f"{called(element)} of {element.get(width)} x {element.get(height)}"
        file = element.get("file")
        if file and element.tag in ("mesh", "hfield", "texture", "skin", "model", "flexcomp"):
            yield _bytes(tree, element, file) / SMALL, f"{called(element)} ({file})"


def _made(element: ElementTree.Element, times: float, by: str = "") -> Iterator[tuple[float, str]]:
    """Elements, each as often as it is made, and by what, if by something that repeats it."""
    for child in element:
        numbers = [float(n) for n in child.get(COUNTS.get(child.tag, ""), "").split() if n.isdecimal()]
        made = times * prod(max(n, 1.0) for n in numbers)
        cause = by or (f"{called(child)} with count {child.get('count')}" if numbers else "")
        yield made / FEW, cause or f"its {child.tag} elements"
        yield from _made(child, made, cause)


def _number(element: ElementTree.Element, key: str) -> float:
    text = element.get(key, "")
    return float(text) if text.strip().isdecimal() else 0.0


def called(element: ElementTree.Element) -> str:
    """An element as messages name it."""
    return f"{element.tag} '{name}'" if (name := element.get("name")) else element.tag


def _bytes(tree: ElementTree.Element, element: ElementTree.Element, file: str) -> float:
    """Bytes of an asset's file; of a packed picture those of its pixels."""
    folders = [value for compiler in tree.iter("compiler") for key, value in compiler.items() if key.endswith("dir")]
    place = next((p for folder in [".", *folders] if (p := Path(folder) / file).is_file()), None)
    if place is None:
        return 0.0
    if element.tag in ("texture", "hfield") and place.suffix.lower() == ".png":
        head = place.open("rb").read(24)
        return 4.0 * int.from_bytes(head[16:20]) * int.from_bytes(head[20:24])
    return float(place.stat().st_size)


def try_in_child(xml: str, path: Path, most: str) -> None:
    """Compile a model in a process of its own, which may die of it.

    Raises:
        CaseError: it died, or took too long.
    """
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    try:
        tried = subprocess.run(
            [sys.executable, "-P", "-c", CHILD], input=xml.encode(), capture_output=True, timeout=SECONDS + 5,
            env=environment, check=False,
        )  # fmt: skip
        said = tried.stderr.decode(errors="replace").strip()
    except subprocess.TimeoutExpired:
        tried, said = None, ""
    ended = "Traceback", "exception", "allocate memory"  # as Python, C++ and MuJoCo say it
    if tried is None or tried.returncode not in (0, 1) or any(word in said for word in ended):
        raise CaseError(
            f"MJCF {path} takes more than {SECONDS} s or {MEMORY >> 30} GB to compile, most of it for {most}; allowed: "
            "what a robot and its surroundings need; make it smaller or leave it out"
        )
    if tried.returncode:
        raise CaseError(f"MJCF {path} does not compile: {summarise_exception(ValueError(said))}; correct it")
