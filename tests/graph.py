"""The workflow's graph: what a run would start, and the package files that its scripts import."""

import ast
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from conftest import ROOT

SNAKEMAKE = Path(sys.executable).with_name("snakemake")


def snakemake(tree: Path, *arguments: str) -> subprocess.CompletedProcess:
    environment = os.environ | {"PYTHONPATH": str(tree / "src")}
    return subprocess.run([SNAKEMAKE, *arguments], cwd=tree, env=environment, capture_output=True, text=True)


def planned(tree: Path, *arguments: str) -> dict[str, int]:
    """Number of jobs per rule that a run would start."""
    done = snakemake(tree, *arguments, "--dry-run")
    assert done.returncode == 0, done.stderr
    stats = re.search(r"^Job stats:\n.*?\n-+  -+\n(.*?)\ntotal ", done.stdout + done.stderr, re.S | re.M)
    rows = [line.split() for line in stats[1].splitlines()] if stats else []
    return {rule: int(count) for rule, count in rows if rule != "all"}


def copy(to: Path) -> Path:
    for name in ("src", "workflow", "config", "profiles"):
        shutil.copytree(ROOT / name, to / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    shutil.copy(ROOT / "Snakefile", to)
    return to


def stages() -> dict[str, list[str]]:
    """The lists of package files in package_files.smk."""
    names: dict = {}
    exec((ROOT / "workflow" / "rules" / "package_files.smk").read_text(), names)
    return names["STAGES"]


def imported(path: Path) -> set[Path]:
    """Package files that `path` imports, directly or through others."""
    found, todo = set(), [path]
    while todo:
        for module in _imports(todo.pop()):
            base = ROOT / "src" / Path(*module.split("."))
            new = {file for file in (base.with_suffix(".py"), base / "__init__.py") if file.exists()} - found
            found, todo = found | new, [*todo, *new]
    return found


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("fimpact"):
            yield "fimpact"
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)


def needed(paths: Iterable[Path]) -> set[str]:
    """Modules that change what a stage makes: progress only talks, and packages are empty."""
    names = {str(path.relative_to(ROOT / "src" / "fimpact")) for path in paths}
    return {name for name in names if Path(name).name not in ("__init__.py", "progress.py", "runtime.py", "tables.py")}
