"""A case that is being drafted: its tables, what the user has to fill in, and what was concluded for him to look at."""

from dataclasses import dataclass, field
from typing import Any

import yaml

from fimpact.cases.drafting.column_names import OPEN

MOST = 6  # names that a line lists


class Asked(str):
    """A unit that the user has to fill in, once for all entries that share it."""

    label: str

    def __new__(cls, label: str) -> "Asked":
        """Make the mark. label: what it stands for, such as "angle"."""
        made = super().__new__(cls, OPEN)
        made.label = label
        return made


class _Dumper(yaml.SafeDumper):
    """YAML with an anchor at each unit that is asked for."""

    def ignore_aliases(self, data) -> bool:
        return not isinstance(data, Asked)

    def generate_anchor(self, node) -> str:
        return node.label


def _asked(dumper: _Dumper, data: Asked) -> yaml.Node:
    node: Any = dumper.represent_scalar("tag:yaml.org,2002:str", OPEN)
    node.label = data.label
    return node


_Dumper.add_representer(Asked, _asked)


@dataclass
class DraftCase:
    """A case to be written. open: what has to be filled in; taken: what was concluded, to be looked at."""

    case: dict
    open: list[str] = field(default_factory=list)
    taken: list[str] = field(default_factory=list)

    def text(self) -> str:
        """The case as YAML, with what is open and what was taken as comments on top."""
        marked = [("fill in", line) for line in self.open] + [("taken", line) for line in self.taken]
        body = yaml.dump(
            self.case, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=200, default_flow_style=None
        )
        return "\n".join([*(f"# {mark}: {line}" for mark, line in marked), body])


def some(names: list[str], most: int = MOST) -> str:
    """Names in a line, the first two and a count where they are many."""
    quoted = [f"'{name}'" for name in names]
    return ", ".join(quoted) if len(quoted) <= most else f"{', '.join(quoted[:2])} and {len(quoted) - 2} more"
