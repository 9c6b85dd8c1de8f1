"""Turns laws into a Python file of its own: their source text and all that it names, without fimpact."""

import ast
import functools
import inspect
import re
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from types import ModuleType
from typing import Any

import numpy as np

OWN = "fimpact"


class SourceBundle:
    """Source text of functions and classes, each after what it needs; objects that share a name are renamed."""

    def __init__(self, given: Mapping[str, str]):
        """given: text of the module constants that are filled in instead of copied, by name."""
        self.given = dict(given)
        self.imports: set[str] = set()
        self.parts: list[str] = []
        self.names: dict[int, str] = {}

    def add(self, thing: Callable | type) -> str:
        """Include `thing`; returns the name that it has in the file."""
        if id(thing) in self.names:
            return self.names[id(thing)]
        name = self.names[id(thing)] = self._free(getattr(thing, "__name__", "law"))
        source = _source(thing)
        for local, value in _needs(thing, source).items():
            source = _rename(source, local, self._include(local, value))
        own = _rename(source, thing.__name__, name)
        enclosed = inspect.getclosurevars(thing).nonlocals if inspect.isfunction(thing) else {}
        self.parts.append(_enclose(own, name, {k: self._value(v) for k, v in enclosed.items()}) if enclosed else own)
        return name

    def text(self) -> str:
        """Imports, constants and code."""
        return "\n".join(sorted(self.imports)) + "\n\n\n" + "\n\n\n".join(part.strip() for part in self.parts) + "\n"

    def _include(self, local: str, value: Any) -> str:
        if isinstance(value, ModuleType):
            self.imports.add(f"import {value.__name__} as {local}" if local != value.__name__ else f"import {local}")
            return local
        if local in self.given:
            return local
        if inspect.isfunction(value) or (inspect.isclass(value) and not issubclass(value, Enum)):
            if value.__module__.partition(".")[0] == OWN:
                return self.add(value)
            self.imports.add(f"from {value.__module__} import {value.__name__} as {local}")
            return local
        if id(value) not in self.names:
            text = self._value(value)
            self.names[id(value)] = self._free(local)
            self.parts.append(f"{self.names[id(value)]} = {text}")
        return self.names[id(value)]

    def _value(self, value: Any) -> str:
        if inspect.isfunction(value):
            return self.add(value)
        if isinstance(value, np.ndarray):
            self.imports.add("import numpy")
            return f"numpy.array({value.tolist()!r})"
        if isinstance(value, np.generic | Enum):
            value = value.item() if isinstance(value, np.generic) else int(value.value)
        text = repr(value)
        if not _literal(text):
            raise ValueError(f"a law uses {text}, which no Python file can state; allowed: numbers, texts, functions")
        return text

    def _free(self, name: str) -> str:
        taken = {*self.names.values(), *self.given}
        return next(n for n in (name, *(f"{name}_{i}" for i in range(2, 99))) if n not in taken)


def partial_arguments(law: Callable, values: Mapping[str, float]) -> tuple[Callable, dict[str, float]]:
    """The plain function behind a partial one, and all its keyword values."""
    if isinstance(law, functools.partial):
        return law.func, {**law.keywords, **values}
    return law, dict(values)


def _source(thing: Callable | type) -> str:
    source = textwrap.dedent(inspect.getsource(thing))
    if getattr(thing, "__name__", "") == "<lambda>" or not source.startswith(("def ", "class ", "@")):
        raise ValueError(f"the law {thing!r} has no source of its own; a law that is exported is written with def")
    return source


def _needs(thing: Callable | type, source: str) -> dict[str, Any]:
    scope = vars(sys.modules[thing.__module__])
    used = {node.id for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name)} - {thing.__name__}
    return {name: scope[name] for name in sorted(used) if name in scope}


def _rename(source: str, old: str, new: str) -> str:
    # A keyword of the same name, as in f(speed=speed), is not the object.
    return source if old == new else re.sub(rf"(?<![\w.]){old}(?!\w|=[^=])", new, source)


def _enclose(source: str, name: str, enclosed: Mapping[str, str]) -> str:
    body = "\n".join([*(f"{key} = {value}" for key, value in enclosed.items()), source, f"return {name}"])
    return f"def _make_{name}():\n{textwrap.indent(body, '    ')}\n\n\n{name} = _make_{name}()"


def _literal(text: str) -> bool:
    try:
        ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return False
    return True


def as_source_list(bundle: SourceBundle, laws: Sequence[tuple[Callable, str, Mapping[str, float]]]) -> str:
    """A Python list of (law, site, values), the laws included in `bundle`."""
    rows = []
    for law, site, values in laws:
        plain, filled = partial_arguments(law, values)
        rows.append(f"({bundle.add(plain)}, {site!r}, { {k: float(v) for k, v in filled.items()} })")
    return f"[{', '.join(rows)}]"
