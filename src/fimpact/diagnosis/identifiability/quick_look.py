"""From a recording to what its motions can show, in a second: no smoother, no search, no simulation."""

import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from fimpact.deciding import BELIEF
from fimpact.diagnosis.identifiability.judging import Asked, Judge
from fimpact.diagnosis.identifiability.motion_model import Commands, EditedCopy, Motion
from fimpact.diagnosis.identifiability.suspects import Suspect, columns, other_sizes, suspects
from fimpact.effects import EFFECTS
from fimpact.effects.base import Effect, Scales
from fimpact.effects.touching import NO_CONTACT, can_touch
from fimpact.effects.wiring import HINGE, SLIDE
from fimpact.recordings import Recording, Run
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.state_guess import Shown, noise_level, shown_by, smooth
from fimpact.smoothing.candidates import scales_along
from fimpact.smoothing.dynamics.inverse import Inverse
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.parameters import Parameter
from fimpact.smoothing.prepare import measured_states, spread_out
from fimpact.smoothing.states import States
from fimpact.smoothing.stretches import spread_of_scores, stretches

ROWS = 600  # samples that are looked at, spread over all
STEPS = 5  # between what is left of a fit and the noise that it is given
LONGEST = 2000  # samples of noise alone
FEWEST = 20  # samples of a run, and rows at most for a reading
ROUND_OFF = 1e-9  # N or N m: less is none


@dataclass(frozen=True)
class Sight:
    """What the motions of a recording show. suspects: all that is asked; judge: of those of them that are forces.
    noise: of the force left in a sample, (nv,); count: samples of the recording; spread: how much less they count.
    still: degrees of freedom that never move, (nv,). fastest: speed that the recordings have, (nv,)."""

    recording: Recording
    motion: Motion
    suspects: tuple[Suspect, ...]
    judge: Judge
    noise: np.ndarray
    count: int
    spread: float
    still: np.ndarray
    scales: Scales

    def further(self, motion: Motion, names: Sequence[str]) -> Judge:
        """Judge the recording and, of `names` and what is fitted anyway, as much again of another motion."""
        asked, force = columns([own for own in self.suspects if own.free or own.name in names], motion)
        known = {own.name: own.columns for own in asked}
        size = len(self.judge.information)
        whole = np.zeros((*motion.qvel.shape, size))
        for own in self.judge.asked:
            if own.name in known:
                whole[:, :, list(own.columns)] = force[:, :, list(known[own.name])]
        return self.judge.with_more(_information(whole, self.noise) * self.count / motion.count / self.spread)


def look(recording: Recording, catalogue: Iterable[Effect] | None = None) -> Sight | str:
    """What the training runs' motions can show; or why that is not told without a diagnosis."""
    recording = on_its_own_grid(recording)
    track = Track(Simulator(recording), spread_out(recording.training, recording.windows))
    noise, model = noise_level(recording), track.model
    if model.neq:
        return "joints or bodies are tied to one another"
    unmeasured = np.flatnonzero(~_measured(track))
    if len(unmeasured):
        return f"nothing measures where {model.joint(int(model.dof_jntid[unmeasured[0]])).name} is"
    states = measured_states(track, noise)
    doubt, jolt = _noise_alone(track, noise)
    still = np.sqrt(np.mean(states.qvel**2, 0)) <= BELIEF * doubt
    free = ~track.touching(states) if can_touch(model) else np.ones(track.count, bool)
    if free.sum() < len(free) / 2:
        return "something touches most of the time"
    motion = _motion(track, states, doubt, still, free)
    scales = _scales(track, states, still)
    asked = suspects(EFFECTS.values() if catalogue is None else catalogue, motion, scales)
    kept, force = columns(asked, motion)
    known = _known(asked, kept)
    every = np.concatenate([force, other_sizes(asked, motion)], 2)
    weights = np.concatenate([known, np.ones(every.shape[2] - len(known))])
    left, size = _left(every, motion.missing, weights, np.maximum(model.dof_M0 * jolt, ROUND_OFF))
    information, spread = _counted(force, left, size, motion)
    own = tuple(s for s in asked if s.name in {k.name for k in kept})
    return Sight(recording, motion, own, Judge(information, known, kept), size, track.count, spread, still, scales)


def on_its_own_grid(recording: Recording) -> Recording:
    """The recording at the pace of its slowest channel: straight lines between readings hold no acceleration."""
    shares = [np.isfinite(run.measured).mean(0) for run in recording.training]
    every = round(1 / max(float(np.median([share.min() for share in shares])), 1 / FEWEST))
    if every < 2:
        return recording
    runs = tuple(_thinned(run, every) for run in recording.runs if len(run.measured) > FEWEST * every)
    return replace(recording, runs=runs, period=recording.period * every) if runs else recording


def _thinned(run: Run, every: int) -> Run:
    count = len(run.measured) // every
    rows = run.measured[: count * every].reshape(count, every, -1)
    seen = np.isfinite(rows).sum(1)
    measured = np.where(seen > 0, np.nansum(rows, 1) / np.maximum(seen, 1), np.nan)
    ctrl = run.ctrl[: count * every].reshape(count, every, -1).mean(1)
    return replace(run, measured=measured, ctrl=ctrl)


def _noise_alone(track: Track, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """sd of the speeds and of the accelerations that noise alone shows once it is smoothed, (nv,) each: what moves no
    faster than that is not seen to move."""
    rng, count, period = np.random.default_rng(0), min(track.count, LONGEST), track.period
    value, slope = smooth(rng.standard_normal(count), period, 1.0)
    speed = {"position": slope, "speed": value, "quaternion": 2 * slope}  # a turn is twice its vector part
    doubt, jolt = np.zeros((2, track.model.nv))
    for shown, sd in zip(_shown(track), noise, strict=True):
        if shown:
            own, found = _dofs(shown), sd * speed[shown.kind]
            doubt[own] = np.maximum(doubt[own], found.std())
            jolt[own] = np.maximum(jolt[own], np.diff(found).std() / period)
    return doubt, jolt


def _shown(track: Track) -> list[Shown | None]:
    return [shown_by(track.model, name) for name in track.recording.channels]


def _dofs(shown: Shown) -> slice:
    return slice(shown.qvel, shown.qvel + (3 if shown.kind == "quaternion" else 1))


def _measured(track: Track) -> np.ndarray:
    """Which degrees of freedom a channel shows, (nv,)."""
    out = np.zeros(track.model.nv, bool)
    for shown in filter(None, _shown(track)):
        out[_dofs(shown)] = True
    return out


def _motion(track: Track, states: States, doubt, still: np.ndarray, free: np.ndarray) -> Motion:
    """The recorded motion, thinned, without what touches and without the noise of joints that stand still."""
    inner = free & ~track.last
    inner[track.bounds[:-1]] = False
    rows = np.flatnonzero(inner)
    every = int(np.ceil(len(rows) / ROWS))
    rows = rows[::every]
    inverse = Inverse(track, states)
    qpos, qvel, qacc = inverse.qpos[rows], inverse.qvel[rows], inverse.qacc[rows]
    qvel[:, still], qacc[:, still] = 0.0, 0.0
    for joint in np.flatnonzero(np.isin(track.model.jnt_type, (HINGE, SLIDE))):
        if still[track.model.jnt_dofadr[joint]]:
            qpos[:, track.model.jnt_qposadr[joint]] = qpos[:, track.model.jnt_qposadr[joint]].mean()
    lengths = np.bincount(track.run_of[rows], minlength=len(track.runs))
    commands = Commands(track.ctrl[:, 0], track.time, tuple(track.lengths), rows)
    return Motion(
        track, EditedCopy(untouched(track.model)), qpos, qvel, qacc, commands, doubt, tuple(lengths[lengths > 0])
    )


def untouched(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy in which nothing touches."""
    own = copy.copy(model)
    own.opt.disableflags |= NO_CONTACT
    return own


def _scales(track: Track, states: States, still: np.ndarray) -> Scales:
    """Typical magnitudes; a joint that stands still counts as one that moves as fast as others of its kind do."""
    own = scales_along(track, track.model, states, np.zeros_like(states.qvel))
    speed, travel = own.speed.copy(), own.travel.copy()
    kinds = track.model.jnt_type[track.model.dof_jntid]
    for dof in np.flatnonzero(still):
        alike = (kinds == kinds[dof]) & ~still
        speed[dof] = speed[alike].max() if alike.any() else pace(own, int(kinds[dof]))
        travel[dof] = travel[alike].max() if alike.any() else reach(own, int(kinds[dof]))
    return replace(own, speed=speed, travel=travel)


def pace(scales: Scales, kind: int) -> float:
    """A speed that is natural for a mechanism of its size, rad/s or m/s: how fast it swings."""
    return float(np.sqrt(scales.gravity / scales.length) * reach(scales, kind))


def reach(scales: Scales, kind: int) -> float:
    """A way that is, rad or m."""
    return 1.0 if kind == HINGE else scales.length


def _known(asked: Sequence[Suspect], kept: Sequence[Asked]) -> np.ndarray:
    """Weights of the priors of all columns, (k,): 0 where the case gives a parameter none."""
    makers = {own.name: own.makers for own in asked}
    firm = [[not isinstance(m, Parameter) or np.isfinite(m.spread) for m, _ in makers[own.name]] for own in kept]
    return np.array([float(one) for own in firm for one in own])


def _left(force: np.ndarray, missing: np.ndarray, known: np.ndarray, least: np.ndarray) -> tuple[np.ndarray, ...]:
    """What is left, (N, nv), of the missing force once all columns have explained what they can, and its size, (nv,),
    at least that of the readings' noise."""
    size = np.maximum(_rms(missing), least)
    left = missing
    for _ in range(STEPS if force.shape[2] else 0):
        inner = _information(force, size) + np.diag(known)
        scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
        right = np.einsum("njk,nj->k", force, missing / size**2)
        value = np.linalg.lstsq(inner / np.outer(scale, scale), right / scale, rcond=1e-12)[0] / scale
        left = missing - force @ value
        size = np.maximum(_rms(left), least)
    return left, size


def _rms(rows: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(rows**2, 0))


def _information(force: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Of the columns of force, (N, nv, k), beside noise of this size, (nv,): (k, k)."""
    rows = (force / size[:, None]).reshape(-1, force.shape[2])
    return rows.T @ rows


def _counted(force, left: np.ndarray, size: np.ndarray, motion: Motion) -> tuple[np.ndarray, float]:
    """Information of the recording, (k, k), and by how much less it counts than white noise would have it: what is left
    of a model repeats itself from sample to sample."""
    whole = _information(force, size)
    if not force.shape[2]:
        return whole, 1.0
    stretch = stretches(motion, left)
    own = np.einsum("njk,nj->nk", force / size[:, None], left / size)
    scores = np.array([np.bincount(stretch, weights=column) for column in own.T]).T
    spread = spread_of_scores(scores, np.diag(whole))
    return whole * motion.track.count / motion.count / spread, spread
