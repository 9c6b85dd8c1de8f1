"""What happened just before and after a window: readings that are late or early show it.

The state before a window is what the simulator's own steps lead from to the window's start. Each is found from the one
after it by Newton's method with one Jacobian, that of the step which ends at the start.
"""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from fimpact.effects.base import Placed, Signal
from fimpact.mismatch.windows import Windows

NOW = 1e-12  # s: nothing is late or early by less
CLOSE, ENOUGH, ROUNDS = 1e-12, 1e-9, 12  # how exactly a step must be undone: aimed at, and needed, of state's size
NUDGE = 1e-5  # m, rad and their rates
FLAT = 1e-4  # of the largest singular value of a step: what has none, such as the norm of a quaternion
WILD = 1e12  # slope of a step: more is none
# Backwards, what is damped grows. Up to the first factor the past is believed, from the second on not at all.
BELIEVED, LOST = 1e2, 1e4

Step = Callable[[int, np.ndarray, np.ndarray, bool], tuple[np.ndarray, np.ndarray]]


def reach(read: Sequence[Placed], signal: Signal, windows: Windows, period: float) -> tuple[int, int]:
    """Samples before and after `windows` that the laws in `read` look at, at most as many as there are.

    Args:
        signal: times and commands of the windows.
    """
    if windows.length < 2:
        return 0, 0
    before = after = 0
    for placed in read:
        wanted = placed.effect.when(signal, placed.site, **placed.values)
        early, late = _asked(wanted, signal.time, windows.first > 0, period)
        before, after = before + early, after + late
    return min(before, int(windows.first.max())), min(after, int(windows.left.max()))


def _asked(wanted: np.ndarray, time: np.ndarray, later: np.ndarray, period: float) -> tuple[int, int]:
    """Samples before and after `time`, (w, T), that reading at `wanted` needs; `later`: windows with a past."""
    if np.abs(wanted - time).max() < NOW:
        return 0, 0
    # One more than that: a cubic looks at two neighbours on either side.
    early = np.ceil(((time - wanted[:, :1])[later, 0] / period).max(initial=-1.0)) + 1
    late = np.ceil(((wanted - time)[:, -1] / period).max()) + 1
    return max(int(early), 0), max(int(late), 0)


def continued(near: np.ndarray, beyond: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Readings `beyond` (w, n, ny) an end of windows, nearest first, as far as they are believed, `share` (w, n), and
    straight on where they are not.

    Args:
        near: the two readings before them, (w, 2, ny), nearest first.
    """
    last, before, out = near[:, 0], near[:, 1], []
    for found, part in zip(beyond.swapaxes(0, 1), share.T[..., None], strict=True):
        line = 2 * last - before
        last, before = np.where(part > 0, part * found + (1 - part) * line, line), last
        out.append(last)
    return np.stack(out, 1) if out else beyond


def backward(
    model: mujoco.MjModel, step: Step, state: np.ndarray, steps: int, checked: bool
) -> tuple[np.ndarray, np.ndarray]:
    """What sensors of `model` read in each of `steps` steps before `state` (w, nq + nv), nearest first, (w, steps,
    sensors), and how far that is to be believed, (w, steps): where a step cannot be undone, not at all from there on.

    Args:
        step: of (k, x, end, loose): the states after step k before the start that begins at x, and what is read at x;
            `end`: where it ends, as far as is known; `loose`: nothing touches and no joint has a limit.
        checked: whether `loose` makes a difference: a past in which something touched is not believed.
    """
    inverse, growth = _inverse(step, state)
    share, sensed = _believed(growth[:, None] ** np.arange(1, steps + 1)), []
    after = guess = state
    for k in range(steps):
        before, read, close, inverse = _before(step, k, after, guess, inverse, share[:, k] > 0)
        if checked:
            reached, read = step(k, before, after, False)
            close &= _miss(reached, after) < ENOUGH
        share[~close, k:] = 0.0
        before = _normal(model, np.where(close[:, None], before, after))
        after, guess = before, 2 * before - after
        sensed.append(read)
    return np.stack(sensed, 1), share


def _normal(model: mujoco.MjModel, state: np.ndarray) -> np.ndarray:
    """`state` with quaternions of length 1: no step leads to others."""
    if model.nq == model.nv:
        return state
    qpos = np.ascontiguousarray(state[:, : model.nq])
    for row in qpos:
        mujoco.mj_normalizeQuat(model, row)
    return np.concatenate([qpos, state[:, model.nq :]], 1)


def _before(step: Step, k: int, after, guess, inverse, asked) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The states from which step k leads to `after`, what is read there, where (w,) that is so, and the `inverse` as
    the way there corrects it."""
    state, last, off, change = guess, np.full(len(after), np.inf), None, None
    for _ in range(ROUNDS):
        reached, read = step(k, state, after, True)
        miss, before, off = _miss(reached, after), off, reached - after
        if change is not None:
            inverse = _corrected(inverse, change, off - before)
        # Rounding and the solver's own error may be in the way of more.
        going = asked & (miss > CLOSE) & ((miss > ENOUGH) | (miss < last / 2)) & np.isfinite(miss)
        if not going.any():
            break
        change = np.where(going[:, None], -(inverse @ off[..., None])[..., 0], 0.0)
        state, last = state + change, np.where(going, miss, last)
    return state, read, asked & (miss < ENOUGH), inverse


def _corrected(inverse: np.ndarray, change: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Broyden's update: `inverse` takes the `effect` that a `change` had, (w, n) each, back to the change."""
    said = (inverse @ effect[..., None])[..., 0]
    along = (change[:, None] @ inverse)[:, 0]
    size = (change * said).sum(1)
    usable = size > (change**2).sum(1) / 2
    share = np.divide(1.0, size, out=np.zeros_like(size), where=usable & (size > 0))
    return inverse + ((change - said) * share[:, None])[..., None] * along[:, None]


def _miss(reached: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    return np.abs(reached - wanted).max(1) / (1 + np.abs(wanted).max(1))


def _inverse(step: Step, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse (w, n, n) of the Jacobian of the step before `state`, and by how much a change grows backwards, (w,)."""
    base = step(0, state, state, True)[0]
    moves = NUDGE * np.eye(state.shape[1])
    slopes = [(step(0, state + move, state, True)[0] - base) / NUDGE for move in moves]
    # A trial that diverges has slopes beyond what can be decomposed.
    finite = np.clip(np.nan_to_num(np.stack(slopes, 2)), -WILD, WILD)
    inverse = np.linalg.pinv(finite, rcond=FLAT)
    return inverse, np.abs(np.linalg.eigvals(inverse)).max(1)


def _believed(growth: np.ndarray) -> np.ndarray:
    """1 to 0, smoothly: a past that came and went would be a jump to every secant."""
    part = np.clip(np.log(np.maximum(growth, 1.0) / BELIEVED) / np.log(LOST / BELIEVED), 0, 1)
    return 1 - part**2 * (3 - 2 * part)
