"""What is wrong with a case or its files, in one line."""

import re
from collections.abc import Iterable, Sequence

from fimpact.support.schema_errors import among

LONG = 120  # characters of a word that is no path, beyond which its middle is left out


class CaseError(ValueError):
    """A case that cannot be used: one line with what is wrong, what was got, what is allowed and what to do."""

    def __init__(self, message: str):
        super().__init__(printable(" ".join(str(message).split())))


def printable(message: str, most: int = 480) -> str:
    """The message as a terminal may show it: no control characters, no endless words, at most so many characters."""
    shown = "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in message)
    shown = re.sub(rf"[^\s/\\]{{{LONG},}}", lambda word: f"{word[0][: LONG // 2]}...{word[0][-10:]}", shown)
    return shown if len(shown) <= most else f"{shown[: most - 80]} ... {shown[-75:]}"


def listed(allowed: Iterable, got: object, most: int = 12) -> str:
    """What is allowed, shortened where it is long, with the nearest to what was given."""
    allowed = list(allowed)
    words = among(allowed, got) if allowed else "allowed: none, there are none"
    if len(allowed) <= most:
        return words
    near = words.partition("; did you mean")[1:]
    return f"allowed: {', '.join(map(str, allowed[:most]))}, ... ({len(allowed)} in all){''.join(near)}"


def one_of(names: Sequence[str], got: str, what: str, where: str) -> str:
    """`got`, if it is one of `names`.

    Raises:
        CaseError: it is not; the line names the nearest.
    """
    if got not in names:
        raise CaseError(f"{where}: {what} '{got}' does not exist; {listed(names, got)}; correct the name")
    return got


def summarise_exception(error: BaseException) -> str:
    """An exception of a library in one short line."""
    words = " ".join(str(error).split()) or type(error).__name__
    return words if len(words) <= 160 else words[:157] + "..."
