"""The motion as the measurements show it, without a model: where estimation starts; and the noise that they carry."""

from collections import defaultdict
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_filter

from fimpact.deciding import TRUSTED
from fimpact.recordings import Recording, Run

WIDTHS = (41, 31, 21, 15, 11, 7, 5)  # samples in a local cubic, widest first
CUBIC = 3  # order of the local polynomials
FITS = 1.5  # standard deviations of noise: the residual up to which a local cubic follows the signal
ROUND_OFF = 1e-3  # of the median step; what is smaller is no quantum
WHOLE = 0.05  # of a quantum, by which a log's own rounding may miss a whole number of them
DIFFERENCES = 3  # order; a smooth signal hardly has any, noise has all
SPREAD = 1.482602218505602  # standard deviations in a median absolute deviation of a normal variable
GAIN = np.sqrt(20.0)  # of third differences of white noise: 1 + 9 + 9 + 1
JOINTPOS, JOINTVEL = int(mujoco.mjtSensor.mjSENS_JOINTPOS), int(mujoco.mjtSensor.mjSENS_JOINTVEL)
FRAMEPOS, FRAMEQUAT = int(mujoco.mjtSensor.mjSENS_FRAMEPOS), int(mujoco.mjtSensor.mjSENS_FRAMEQUAT)
BALLQUAT = int(mujoco.mjtSensor.mjSENS_BALLQUAT)
BODY, XBODY = int(mujoco.mjtObj.mjOBJ_BODY), int(mujoco.mjtObj.mjOBJ_XBODY)
FREE = int(mujoco.mjtJoint.mjJNT_FREE)


@dataclass(frozen=True)
class Shown:
    """What a channel shows of the state.

    kind: "position", "speed" or "quaternion". qpos, qvel: index of the number or, of a quaternion, of its first. part:
    component. body: whose inertial frame it is, or -1 for the joint's own.
    """

    kind: str
    qpos: int
    qvel: int
    part: int = 0
    body: int = -1


def shown_by(model: mujoco.MjModel, channel: str) -> Shown | None:
    """Tell what `channel` shows of the state; None: nothing directly, as a gyroscope or a force sensor."""
    name, _, inside = channel.removesuffix("]").partition("[")
    sensor, part = model.sensor(name), int(inside or 0)
    kind, owner = int(sensor.type[0]), int(sensor.objid[0])
    if kind in (JOINTPOS, JOINTVEL, BALLQUAT):
        q, v = int(model.jnt_qposadr[owner]), int(model.jnt_dofadr[owner])
        return Shown({JOINTPOS: "position", JOINTVEL: "speed", BALLQUAT: "quaternion"}[kind], q, v, part)
    if kind not in (FRAMEPOS, FRAMEQUAT) or int(sensor.objtype[0]) not in (BODY, XBODY) or sensor.refid[0] >= 0:
        return None
    joint = model.body_jntadr[owner]
    if joint < 0 or model.jnt_type[joint] != FREE:
        return None
    q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    inertial = owner if int(sensor.objtype[0]) == BODY else -1
    if kind == FRAMEPOS:
        return Shown("position", q + part, v + part, part, inertial)
    return Shown("quaternion", q + 3, v + 3, part, inertial)


def measured_motion(
    model: mujoco.MjModel, recording: Recording, run: Run, noise: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimate a whole run's motion by local cubics through its measurements, gaps bridged by straight lines.

    A joint of which only the speed is measured is integrated from its start; one that is not measured rests there: at
    `run.qpos`, or in the model's reference configuration.

    Args:
        noise: sd of each channel, (ny,); None: `noise_level`.

    Returns:
        qpos (T, nq), qvel (T, nv), and which coordinates a channel shows, (nv,).
    """
    noise, period = noise_level(recording) if noise is None else noise, recording.period
    start = model.qpos0 if run.qpos is None else run.qpos
    qpos, qvel = np.tile(start, (len(run.measured), 1)), np.zeros((len(run.measured), model.nv))
    shown = _channels(model, recording, run)
    known, placed = np.zeros(model.nv, bool), {s.qvel for s, _ in shown if s.kind == "position"}
    for channel, column in shown:
        if channel.kind == "position":
            qpos[:, channel.qpos], qvel[:, channel.qvel] = smooth(run.measured[:, column], period, noise[column])
            known[channel.qvel] = True
    for channel, column in shown:
        if channel.kind == "speed":
            speed = qvel[:, channel.qvel] = smooth(run.measured[:, column], period, noise[column])[0]
            known[channel.qvel] = True
            if channel.qvel not in placed:
                qpos[1:, channel.qpos] += np.cumsum(speed[1:] + speed[:-1]) * period / 2
    for first, columns in _quaternions(shown).items():
        _turn(model, qpos, qvel, first, run.measured[:, columns], period, noise[columns])
        known[first.qvel : first.qvel + 3] = True
    _to_own_frames(model, shown, qpos, qvel)
    return qpos, qvel, known


def _channels(model: mujoco.MjModel, recording: Recording, run: Run) -> list[tuple[Shown, int]]:
    """What is shown, and the column, of the channels that the run has measured."""
    found = [(shown_by(model, name), i) for i, name in enumerate(recording.channels)]
    return [(shown, i) for shown, i in found if shown and np.isfinite(run.measured[:, i]).any()]


def _quaternions(shown: list[tuple[Shown, int]]) -> dict[Shown, list[int]]:
    """The columns of all four components, by what the first of them shows."""
    groups: defaultdict[int, dict[int, tuple[Shown, int]]] = defaultdict(dict)
    for channel, column in shown:
        if channel.kind == "quaternion":
            groups[channel.qpos][channel.part] = channel, column
    whole = [parts for parts in groups.values() if len(parts) == 4]
    return {parts[0][0]: [parts[i][1] for i in range(4)] for parts in whole}


def _turn(model, qpos, qvel, shown: Shown, measured: np.ndarray, period: float, noise: np.ndarray) -> None:
    """Write a measured quaternion, (T, 4), and the angular velocity in its own axes that follows."""
    parts = [smooth(row, period, sd) for row, sd in zip(_one_sign(measured).T, noise, strict=True)]
    value, slope = (np.stack(own, 1) for own in zip(*parts, strict=True))
    size = np.maximum(np.linalg.norm(value, axis=1, keepdims=True), 1e-12)
    conjugate = value / size * [1, -1, -1, -1]
    spin = np.empty((len(value), 4))
    for out, back, rate in zip(spin, conjugate, slope / size, strict=True):
        mujoco.mju_mulQuat(out, back, rate)
    qpos[:, shown.qpos : shown.qpos + 4] = value / size
    qvel[:, shown.qvel : shown.qvel + 3] = 2 * spin[:, 1:]
    if shown.body >= 0:  # its principal axes turn with the body, at the same rate along other axes
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, model.body_iquat[shown.body])
        qvel[:, shown.qvel : shown.qvel + 3] @= matrix.reshape(3, 3).T


def _one_sign(quaternion: np.ndarray) -> np.ndarray:
    """Signs, which mean nothing, as they change least from one known sample to the next."""
    out = quaternion.copy()
    known = np.flatnonzero(np.isfinite(out).all(1))
    agree = np.sign((out[known][1:] * out[known][:-1]).sum(1))
    out[known[1:]] *= np.cumprod(np.where(agree < 0, -1.0, 1.0))[:, None]
    return out


def _to_own_frames(model: mujoco.MjModel, shown: list[tuple[Shown, int]], qpos, qvel) -> None:
    """Turn and move inertial frames of free bodies, which sensors of a `body` show, to where the joint is."""
    for joint in range(model.njnt):
        body, q, v = (int(own[joint]) for own in (model.jnt_bodyid, model.jnt_qposadr, model.jnt_dofadr))
        kinds = {s.kind for s, _ in shown if s.body == body}
        back, offset = model.body_iquat[body] * [1, -1, -1, -1], np.empty(3)
        for place, speed in zip(qpos, qvel, strict=True) if kinds else ():
            if "quaternion" in kinds:
                mujoco.mju_mulQuat(place[q + 3 : q + 7], place[q + 3 : q + 7].copy(), back)
            if "position" in kinds:
                mujoco.mju_rotVecQuat(offset, model.body_ipos[body], place[q + 3 : q + 7])
                place[q : q + 3] -= offset
                swing = np.cross(speed[v + 3 : v + 6], model.body_ipos[body])
                mujoco.mju_rotVecQuat(offset, swing, place[q + 3 : q + 7])
                speed[v : v + 3] -= offset


def smooth(signal: np.ndarray, period: float, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Smooth `signal` (T,), NaN where missing: value and slope, per s, of a local cubic about each sample.

    At each it is the widest that leaves no more than noise, so that impacts stay sharp.
    """
    known = np.flatnonzero(np.isfinite(signal))
    whole = np.interp(np.arange(len(signal)), known, signal[known])
    seen = np.isfinite(signal).astype(float)
    value, slope = whole, np.gradient(whole, period) if len(whole) > 1 else np.zeros_like(whole)
    for width in (w for w in reversed(WIDTHS) if w <= len(whole)):  # wider ones replace narrower ones where they fit
        fit = savgol_filter(whole, width, CUBIC)
        left = uniform_filter1d((fit - whole) ** 2 * seen, width, mode="nearest")
        count = np.maximum(uniform_filter1d(seen, width, mode="nearest"), 1 / width)
        good = (left / count < (FITS * noise) ** 2) | (width == WIDTHS[-1])
        value = np.where(good, fit, value)
        slope = np.where(good, savgol_filter(whole, width, CUBIC, deriv=1, delta=period), slope)
    return value, slope


def noise_level(recording: Recording) -> np.ndarray:
    """Estimate the standard deviation of each channel's noise, (ny,), where it is not given, never from a model.

    It comes from third differences, and is at least the quantum / sqrt(12): no more where they show nothing else.

    Raises:
        ValueError: a channel never changes, so that nothing can be told.
    """
    level = np.array(recording.noise, float)
    for column in map(int, np.flatnonzero(~np.isfinite(level))):
        signals = _signals(recording, column)
        coarse = _quantum(signals) / np.sqrt(12)
        level[column] = coarse if _only_coarse(signals) else max(_rough(signals), coarse)
        if not level[column]:
            raise ValueError(f"the noise of '{recording.channels[column]}' is 0 by its samples; declare its `noise`")
    return level


def believed_noise(recording: Recording, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest standard deviation of each channel's noise that is believed, (ny,) each.

    Args:
        noise: what the samples show, (ny,). An encoder's whole steps are known; noise beside them is not.
    """
    low, high = TRUSTED[0] * noise, TRUSTED[1] * noise
    for column, level in enumerate(noise):
        signals = _signals(recording, column)
        low[column] = max(low[column], min(level, _quantum(signals) / np.sqrt(12)))
        if _only_coarse(signals) and not np.isfinite(recording.noise[column]):
            low[column] = high[column] = level
    return low, high


def _signals(recording: Recording, column: int) -> list[np.ndarray]:
    return [_on_its_own_grid(run.measured[:, column]) for run in recording.runs]


def _only_coarse(signals: list[np.ndarray]) -> bool:
    """Whether readings are whole steps, and third differences show no more than one of them: rounding, not noise."""
    quantum = _quantum(signals)
    if not quantum:
        return False
    steps = np.concatenate([np.diff(signal) for signal in signals]) / quantum
    steps = steps[np.isfinite(steps)]
    whole = np.abs(steps - np.round(steps)) < WHOLE
    return bool(whole.all()) and _rough(signals) * GAIN / SPREAD < quantum * (1 + WHOLE)


def _on_its_own_grid(signal: np.ndarray) -> np.ndarray:
    """The samples there are, where they are slower than the grid; else with their gaps."""
    known = np.isfinite(signal)
    slower = np.isfinite(np.diff(signal, DIFFERENCES)).sum() < known.sum() / 2
    return signal[known] if slower else signal


def _rough(signals: list[np.ndarray]) -> float:
    differences = np.concatenate([np.diff(signal, DIFFERENCES) for signal in signals])
    known = np.abs(differences[np.isfinite(differences)])
    return float(SPREAD * np.median(known) / GAIN) if len(known) else 0.0


def _quantum(signals: list[np.ndarray]) -> float:
    steps = np.concatenate([np.abs(np.diff(signal)) for signal in signals])
    steps = steps[steps > 0]
    return float(steps[steps > ROUND_OFF * np.median(steps)].min()) if len(steps) else 0.0
