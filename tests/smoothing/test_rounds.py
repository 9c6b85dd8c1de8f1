"""When a round of a fit is taken back, and when rounds that go to and fro are enough."""

from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.smoothing.rounds import is_ahead, runs_away


@pytest.mark.parametrize(
    ("before", "now", "away"),
    [
        (90.0, 1e9, True),
        (90.0, np.inf, True),
        (90.0, np.nan, True),
        (90.0, 150.0, False),
        (1e9, 1e12, False),
        (None, 1e9, False),
    ],
)
def test_a_step_that_leaves_the_readings_behind_runs_away(before, now, away):
    """But where they were as far away before, as at the start of a fit."""
    last = before and SimpleNamespace(chi2=before)
    assert bool(runs_away(SimpleNamespace(chi2=now), last, 100)) == away


@pytest.mark.parametrize(
    ("losses", "bar", "ahead"),
    [
        ([-110, -119, -112], 0.0, True),
        ([-110, -130, -112], 0.0, False),
        ([5, -119, -112], 0.0, False),
        ([-110, -111], np.inf, False),
        ([], 0.0, False),
    ],
)
def test_rounds_to_and_fro_are_ahead_where_they_differ_by_less_than_a_tenth_of_it(losses, bar, ahead):
    assert is_ahead(losses, bar) == ahead
