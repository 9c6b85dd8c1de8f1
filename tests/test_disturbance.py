"""What random forces make of a residual, and how that changes with their sizes and memory."""

from dataclasses import replace

import numpy as np

from fimpact.mismatch.disturbance import Disturbance, _pushed
from fimpact.mismatch.pulses import BINS

NV, NUDGE = 2, 1e-5
PUSHING = Disturbance(np.array([0.7, 2.0]), 3.0)


def test_slopes_are_those_of_what_they_belong_to():
    rng = np.random.default_rng(0)
    columns, residual = rng.normal(size=(5, 40, NV * BINS)), rng.normal(size=(5, 40))
    seen = columns.transpose(0, 2, 1) @ columns, np.einsum("wmb,wm->wb", columns, residual)
    volume, taken, *slopes = _pushed(PUSHING, *seen)
    # Of one window: log det (I + P K P') and what it takes of the squares, r' r - r' (I + P K P')^-1 r.
    whole = [np.eye(40) + own @ PUSHING.root() @ PUSHING.root().T @ own.T for own in columns]
    left = sum(r @ np.linalg.solve(v, r) for r, v in zip(residual, whole, strict=True))
    np.testing.assert_allclose([volume, taken], [np.linalg.slogdet(whole)[1].sum(), (residual**2).sum() - left])
    for i, moved in enumerate(_nudged()):
        np.testing.assert_allclose(
            [s[i] for s in slopes], np.subtract(*(_pushed(m, *seen)[:2] for m in moved)) / NUDGE, 1e-5
        )


def _nudged():
    """PUSHING with the log of each variance, and of the memory, half a nudge more and less."""
    for dof in range(NV):
        steps = (np.exp(sign * NUDGE / 4 * (np.arange(NV) == dof)) for sign in (1, -1))
        yield [replace(PUSHING, sd=PUSHING.sd * step) for step in steps]
    yield [replace(PUSHING, memory=PUSHING.memory * np.exp(sign * NUDGE / 2)) for sign in (1, -1)]
