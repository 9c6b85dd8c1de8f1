"""Every number that decides an answer stands in one module, with its reason; there are few, and none stands twice."""

import ast
import io
import tokenize
from pathlib import Path

import pytest

from fimpact import deciding

MOST = 24
PACKAGE = Path(deciding.__file__).parent
MODULES = sorted(p for folder in ("smoothing", "selection", "diagnosis") for p in (PACKAGE / folder).rglob("*.py"))
NUMERICAL = {0.5, *map(float, range(13))}  # too common to be anybody's: halves, squares and counts


def decided() -> dict[str, ast.expr]:
    """Names that `deciding` assigns, and what to."""
    body = ast.parse(Path(deciding.__file__).read_text(encoding="utf-8")).body
    return {statement.targets[0].id: statement.value for statement in body if isinstance(statement, ast.Assign)}


def numbers(node: ast.AST) -> set[float]:
    """Numbers in a piece of code."""
    own = (part.value for part in ast.walk(node) if isinstance(part, ast.Constant))
    return {float(value) for value in own if isinstance(value, int | float) and not isinstance(value, bool)}


def constants(path: Path) -> dict[str, ast.expr]:
    """Module-level names in capitals that hold numbers."""
    body = ast.parse(path.read_text(encoding="utf-8")).body
    own = [(target, s.value) for s in body if isinstance(s, ast.Assign) for target in s.targets]
    found = {target.id: value for target, value in own if isinstance(target, ast.Name)}
    return {name: value for name, value in found.items() if name.isupper() and numbers(value)}


def test_few_numbers_decide():
    assert 0 < len(decided()) <= MOST


def test_every_number_has_its_reason():
    source = Path(deciding.__file__).read_text(encoding="utf-8")
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    told = {token.start[0]: token.string for token in tokens if token.type == tokenize.COMMENT}
    for name, value in decided().items():
        assert len(told.get(value.end_lineno, "").split()) > 2, f"{name} has no reason"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_no_module_repeats_one(path):
    taken = {name for name in decided() if name in constants(path)}
    assert not taken, f"{taken} of deciding.py is assigned here again"
    rare = set.union(*(numbers(value) for value in decided().values())) - NUMERICAL
    body = ast.parse(path.read_text(encoding="utf-8"))
    compared = [node for node in ast.walk(body) if isinstance(node, ast.Compare)]
    again = rare & set().union(*(numbers(node) for node in compared))
    assert not again, f"{again} of deciding.py decides here too, without its name"


@pytest.mark.parametrize("name", sorted(decided()))
def test_every_number_is_used(name):
    users = [path for path in PACKAGE.rglob("*.py") if path.name != "deciding.py"]
    assert any(name in _imported(path) for path in users), f"{name} decides nothing"


def _imported(path: Path) -> set[str]:
    body = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    own = [node for node in body if isinstance(node, ast.ImportFrom) and node.module == "fimpact.deciding"]
    return {alias.name for node in own for alias in node.names}
