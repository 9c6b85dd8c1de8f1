"""What a further experiment says about the explanations that could not be told apart.

All runs are diagnosed anew: what comes out may be a name that was not among those that the experiment was to separate.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from fimpact.diagnosis.pipeline import Diagnosis, diagnose
from fimpact.recordings import Recording, Run


@dataclass(frozen=True)
class Resolved:
    """One explanation; weight: its share, beside all others, of what all runs together leave."""

    name: str
    weight: float


def resolve(
    recording: Recording,
    added: Sequence[Run],
    before: Sequence[str],
    progress: Callable[[str], None] = lambda line: None,
) -> tuple[list[Resolved], list[str]]:
    """Diagnose `recording` with the runs that were `added` to it.

    Args:
        before: names that could not be told apart.

    Returns:
        What is left now and, with no weight, what is no longer, in falling order; and the names that are left, the
        answer first.
    """
    runs = (*recording.runs, *(replace(run, held_out=False) for run in added))
    found = diagnose(replace(recording, runs=runs), progress, brief=True)
    return ranked(found, before), found.answer_set


def ranked(found: Diagnosis, before: Sequence[str]) -> list[Resolved]:
    """Weigh what a diagnosis leaves, and what was there `before` it."""
    left = {member.name: member.weight for member in found.members} or {found.answer: 1.0}
    total = sum(left.values())
    own = [Resolved(name, weight / total) for name, weight in left.items()]
    return own + [Resolved(name, 0.0) for name in before if name not in left]
