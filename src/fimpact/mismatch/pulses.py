"""Forces that no catalogue names: short pulses on each degree of freedom, and what the robot was doing meanwhile.

A window is a fraction of a second, so a force that depends on anything is nearly constant in an eighth of it. The
sensitivities to such pulses, weighted by any function of state, give the sensitivity to that function as a force:
arbitrary curves are tested at the price of two dozen simulations.
"""

from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np
from scipy.signal import lfilter

from fimpact.mismatch.commands import DIRECT
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.scales import scales
from fimpact.mismatch.tangent import has_tangent, tangent
from fimpact.mismatch.touch import can_touch
from fimpact.mismatch.windows import Windows

BINS = 8  # pieces of a window in which the force is constant
PROBE = 0.02  # of the root mean square force
IMPACT = 0.03  # s after contact begins
UNBOUNDED = 1e60  # standard deviations per N or N m
RATES, RINGING = (
    2 * np.pi * np.array([1.0, 2.0, 4.0, 8.0]),
    0.1,
)  # rad/s of what may swing unseen, and its damping ratio


@dataclass(frozen=True)
class Felt:
    """What windows show of forces and of late clocks. columns (w, m, nv * BINS): sensitivities to a unit force on each
    degree of freedom in each bin. clocks (w, m, runs): to a clock that is one sampling period late, for each run."""

    columns: np.ndarray
    clocks: np.ndarray


@dataclass(frozen=True)
class Pulses(Felt):
    """And what the robot was doing: names of the degrees of freedom, `dofs`, and at the middle of each bin
    time (w, BINS) s since the start of the run, qpos (w, BINS, nq), qvel (w, BINS, nv), ctrl (w, BINS, nu), and the
    contact mode (w, BINS): "free", "impact" or "contact". swing (w, BINS, nv, 2 RATES): of what would swing unseen,
    struck by each change of speed since the run began, or the last gap between windows. driven: the degree of freedom
    behind each actuator, or -1."""

    dofs: tuple[str, ...]
    time: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    ctrl: np.ndarray
    mode: np.ndarray
    swing: np.ndarray
    driven: tuple[int, ...]

    @property
    def runs(self) -> np.ndarray:
        """Run of each window, (w,), as a number that is its own: it is the run whose clock moves it. One in which
        nothing moves counts as a run by itself."""
        moved = np.abs(self.clocks).max(1)
        return np.where(moved.any(1), moved.argmax(1), -1 - np.arange(len(moved)))

    def ends(self, memory: float) -> tuple[np.ndarray, np.ndarray]:
        """Sensitivities, (w, m, nv) each, to a force that is 1 in the middle of a window and fades in `memory` bins,
        or grows as fast."""
        fade = np.exp(-(np.arange(BINS) - (BINS - 1) / 2) / memory)
        each = self.columns.reshape(*self.columns.shape[:2], -1, BINS)
        return each @ fade, each @ fade[::-1]

    @property
    def middle(self) -> np.ndarray:
        """Of each window, (w,), in bins since the start of its run."""
        width = (self.time[:, -1] - self.time[:, 0]).mean() / (BINS - 1)
        return self.time.mean(1) / width

    def kept(self, memory: float) -> np.ndarray:
        """Correlation, (w, w), of forces at the middle of windows, which forget themselves within `memory` bins; those
        of different runs know nothing of each other."""
        apart = np.abs(np.subtract.outer(self.middle, self.middle))
        return np.equal.outer(self.runs, self.runs) * np.exp(-apart / memory)

    def along(self, dof: int, curve: np.ndarray) -> np.ndarray:
        """Sensitivity, (w, m), to the force `curve`, (w, BINS), on one degree of freedom."""
        return np.einsum("wmb,wb->wm", self.columns[:, :, dof * BINS : (dof + 1) * BINS], curve)


def pulses(problem: Problem, fitted: Fit) -> Pulses:
    """Pulses at the fitted point of `problem`, and what the robot was doing meanwhile."""
    found, dofs = felt(problem, fitted), dof_names(problem.simulator.base)
    return Pulses(found.columns, found.clocks, dofs, *_meanwhile(problem, fitted))


def felt(problem: Problem, fitted: Fit) -> Felt:
    """Pulses at the fitted point of `problem`, without what the robot was doing, which takes longer to ask."""
    respond = _slopes if has_tangent(problem.simulator, fitted.point) else _secants
    # A linearised motion may diverge: what a pulse does there is as good as unbounded, and must not overflow.
    forces = np.clip(np.nan_to_num(respond(problem, fitted)), -UNBOUNDED, UNBOUNDED)
    return Felt(problem.extend(forces), _clocks(problem, fitted))


def _slopes(problem: Problem, fitted: Fit) -> np.ndarray:
    found = tangent(problem, fitted.point)
    steps, nv = len(found.passed), problem.simulator.base.nv
    bins = np.repeat(np.eye(BINS), np.diff(np.linspace(0, problem.windows.length, BINS + 1).astype(int)), 0)
    forces = np.einsum("nb,ij->nijb", np.repeat(bins, found.every, 0), np.eye(nv)).reshape(1, steps, nv, -1)
    change = found.response(np.broadcast_to(forces, (len(problem.windows.runs), *forces.shape[1:])))
    return np.stack([problem.whiten(change[..., c]) for c in range(change.shape[3])], 2)


def _secants(problem: Problem, fitted: Fit) -> np.ndarray:
    point, length = fitted.point, problem.windows.length
    base = problem.predict(point.hypothesis, point.qpos, point.qvel)
    size, columns = PROBE * scales(problem, point).force, []
    edges = np.linspace(0, length, BINS + 1).astype(int)
    for dof in range(problem.simulator.base.nv):
        for first, last in pairwise(edges):
            push = np.zeros((1, length, problem.simulator.base.nv))
            push[0, first:last, dof] = size[dof]
            change = problem.predict(point.hypothesis, point.qpos, point.qvel, push) - base
            columns.append(change / size[dof])
    return np.stack(columns, 2)


def _clocks(problem: Problem, fitted: Fit) -> np.ndarray:
    point, windows = fitted.point, problem.windows
    predicted = problem.simulator.predict(point.hypothesis, windows, point.qpos, point.qvel)
    late = problem.whiten(-np.gradient(predicted, axis=1))
    own = windows.runs[:, None] == np.unique(windows.runs)
    return problem.extend(late[:, :, None] * own[:, None, :])


def dof_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Name, or number, of the joint behind each degree of freedom; those of free and ball joints are numbered."""
    names = []
    for dof in range(model.nv):
        joint = model.jnt(int(model.dof_jntid[dof]))
        several = (model.dof_jntid == model.dof_jntid[dof]).sum() > 1
        name = joint.name or f"joint {joint.id}"
        names.append(f"{name}[{dof - joint.dofadr[0]}]" if several else name)
    return tuple(names)


def _meanwhile(problem: Problem, fitted: Fit) -> tuple:
    simulator, windows, point = problem.simulator, problem.windows, fitted.point
    qpos, qvel = simulator.motion(point.hypothesis, windows, point.qpos, point.qvel)
    middle = ((np.arange(BINS) + 0.5) * qpos.shape[1] / BINS).astype(int)
    row = windows.first[:, None] + middle // simulator.substeps
    ctrl = windows.ctrl[windows.runs[:, None], np.minimum(row, windows.ctrl.shape[1] - 1)]
    time = (windows.first[:, None] + middle / simulator.substeps) * simulator.recording.period
    model = simulator.model(point.hypothesis)
    mode = _modes(_touching(model, qpos), round(IMPACT / model.opt.timestep))
    swing = _swings(windows, np.concatenate([point.qvel[:, None], qvel], 1), model.opt.timestep)
    return time, qpos[:, middle], qvel[:, middle], ctrl, mode, swing, _driven(model)


def _swings(windows: Windows, qvel: np.ndarray, step: float) -> np.ndarray:
    """Deflection and its quadrature, (w, BINS, nv, 2 RATES), of oscillators that are carried along and start at rest.

    Args:
        qvel: at the start of each window and after each of its steps, (w, n + 1, nv).
    """
    turn = np.exp((1j - RINGING) * RATES * step)
    out = np.empty((len(qvel), qvel.shape[1] - 1, qvel.shape[2], len(RATES)), complex)
    for run in np.unique(windows.runs):
        now, end = np.zeros(out.shape[2:], complex), None
        for w in np.flatnonzero(windows.runs == run):
            if end is None or windows.first[w] != end[0]:
                now = np.zeros_like(now)
            else:
                now = now + (qvel[w, 0] - end[1])[:, None]
            struck = np.diff(qvel[w], axis=0)
            for i, own in enumerate(turn):
                out[w, :, :, i], last = lfilter([1.0], [1.0, -own], struck, 0, (own * now[:, i])[None])
                now[:, i] = last[0] / own
            end = windows.first[w] + windows.length, qvel[w, -1]
    edges = np.linspace(0, out.shape[1], BINS + 1).astype(int)
    mean = np.stack([out[:, first : max(last, first + 1)].mean(1) for first, last in pairwise(edges)], 1)
    return np.concatenate([mean.real, mean.imag], 3)


def _driven(model: mujoco.MjModel) -> tuple[int, ...]:
    direct = np.isin(model.actuator_trntype, [int(kind) for kind in DIRECT])
    joints = model.actuator_trnid[:, 0]
    return tuple(int(model.jnt_dofadr[j]) if own else -1 for own, j in zip(direct, joints, strict=True))


def _modes(touching: np.ndarray, since: int) -> np.ndarray:
    """Mode of each bin, (w, BINS), from contact in each step, (w, n)."""
    mode = np.full((len(touching), BINS), "free", dtype="<U7")
    edges = np.linspace(0, touching.shape[1], BINS + 1).astype(int)
    for w, row in enumerate(touching):
        begins = np.flatnonzero(row & ~np.append(False, row[:-1]))
        for b, (first, last) in enumerate(pairwise(edges)):
            if row[first:last].any():
                fresh = ((begins >= first - since) & (begins < last)).any()
                mode[w, b] = "impact" if fresh else "contact"
    return mode


def _touching(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """Whether any contact is closed, (w, n)."""
    out = np.zeros(qpos.shape[:2], bool)
    if not can_touch(model):
        return out
    data = mujoco.MjData(model)
    for place in np.ndindex(out.shape):
        data.qpos[:] = qpos[place]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        out[place] = bool((data.contact.dist[: data.ncon] < 0).any())
    return out
