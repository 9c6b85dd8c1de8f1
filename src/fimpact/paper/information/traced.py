"""Programs that are traced once per machine instead of once per process.

Tracing a differentiated MJX rollout takes longer than running thousands of them, and every Snakemake job is a
process of its own. `jax.export` writes the traced program beside XLA's compile cache; the next process reads it.
"""

import hashlib
import os
from collections.abc import Callable
from functools import lru_cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

import fimpact.paper.mjx.engine  # noqa: F401

import jax
import numpy as np
from jax import export

from fimpact.paper.mjx.runtime import cache_folder

# What a traced program depends on, besides its key and arguments.
SOURCES = ("mjx", "systems")


def traced(function: Callable, key: str, result: Callable) -> Callable:
    """`function`, compiled, with its trace kept on disk under `key` and the versions of code and libraries.

    Args:
        function: of pytrees of arrays, always called with the same structure and shapes; returns arrays, flat.
        result: makes what is returned from the arrays, such as a NamedTuple.
    """
    ready: list[Callable] = []

    def call(*args):
        leaves, structure = jax.tree.flatten(args)
        if not ready:
            shapes = [jax.ShapeDtypeStruct(np.shape(leaf), np.asarray(leaf).dtype) for leaf in leaves]
            ready.append(_load(lambda *flat: function(*jax.tree.unflatten(structure, flat)), key, shapes))
        return result(*ready[0](*leaves))

    return call


def _load(function: Callable, key: str, shapes: list[jax.ShapeDtypeStruct]) -> Callable:
    path = _path(f"{key} {shapes}")
    if not path.exists():
        _write(path, export.export(jax.jit(lambda *leaves: tuple(function(*leaves))))(*shapes).serialize())
    return jax.jit(export.deserialize(bytearray(path.read_bytes())).call)


def _path(key: str) -> Path:
    versions = " ".join(f"{name}-{version(name)}" for name in ("jax", "mujoco", "mujoco-mjx"))
    digest = hashlib.sha256(f"{key} {versions} {_source()}".encode()).hexdigest()
    return cache_folder() / "traced" / digest[:32]


@lru_cache
def _source() -> str:
    package = Path(str(files("fimpact.paper")))
    found = sorted(f for name in SOURCES for f in package.glob(f"{name}/*"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in found if path.is_file())).hexdigest()


def _write(path: Path, content: bytes) -> None:
    # Written aside and renamed, so that a job beside this one never reads half a program.
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_suffix(f".{os.getpid()}")
    aside.write_bytes(content)
    aside.replace(path)
