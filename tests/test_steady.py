"""A secant across the instant of a collision shows a jump, which says nothing."""

import numpy as np
import pytest

from fimpact.mismatch.steady import steadied, together


def asked(change, others):
    """What `steadied` makes of `change`, and the shares at which windows were tried again; `others`: of those."""
    shares = []

    def again(share, rows):
        shares.append((share, rows.tolist()))
        return others[share][rows]

    return steadied(lambda columns: columns, change, again), shares


def test_a_jump_at_one_length_gives_way_to_what_another_shows():
    calm = np.ones((6, 3))
    jump = calm.copy()
    jump[2] = 50.0
    found, shares = asked(jump, {0.2: jump, 5.0: calm})
    assert found == pytest.approx(calm) and shares == [(0.2, [2]), (5.0, [2])]


def test_what_shows_at_every_length_is_kept():
    loud = np.ones((6, 3))
    loud[2] = 50.0
    assert asked(loud, {0.2: loud, 5.0: loud})[0] == pytest.approx(loud)


def test_windows_that_count_alike_are_not_tried_again():
    found, shares = asked(np.ones((6, 3)), {})
    assert found == pytest.approx(np.ones((6, 3))) and not shares


def test_beside_what_imitates_it_a_smaller_jump_shows():
    """Of the change itself it is a fiftieth, but most of what no other column gives."""
    rng = np.random.default_rng(0)
    known, own = rng.standard_normal((30, 4, 1)), 0.02 * rng.standard_normal((30, 4))
    calm = known[:, :, 0] + own
    jump = calm.copy()
    jump[3] += 1.0
    slopes = [lambda share, rows: calm[rows]]
    assert asked(jump, {})[1] == []
    assert together(lambda columns: columns, known, [jump], slopes)[0] == pytest.approx(calm)
    assert together(lambda columns: columns, known[:, :, :0], [jump], slopes)[0] == pytest.approx(jump)
