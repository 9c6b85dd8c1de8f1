"""The order in which a verdict says what is sure, what may be, and what has no name."""

import pytest

from fimpact.diagnosis.wording.certainty import CERTAIN, POSSIBLE, Finding
from fimpact.diagnosis.wording.verdict import verdict

NAMELESS = "Something is missing that the catalogue cannot name."
LEFT = "Left without a name at shoulder: the sway of what it stands on (59% of what was missing there)."


def told(tier: str, left: str) -> str:
    return verdict([Finding("gain", "t1", tier, (), None)], [], True, left, [])


@pytest.mark.parametrize(
    ("tier", "left", "first"),
    [
        (CERTAIN, LEFT, "Missing: gain at t1."),
        (POSSIBLE, LEFT, NAMELESS),
        (POSSIBLE, "", "May be missing: gain at t1."),
    ],
)
def test_what_is_sure_comes_first_with_or_without_a_name(tier, left, first):
    said = told(tier, left)
    assert said.startswith(first) and said.endswith(left)
    assert (NAMELESS in said) == (first == NAMELESS) and "missing: gain at t1." in said.lower()


def test_what_is_missing_without_a_name_is_said_so():
    assert verdict([], [], True, LEFT, []) == f"{NAMELESS} {LEFT}"
    assert verdict([], [], False, "", []) == "Nothing is missing that these recordings can show."
