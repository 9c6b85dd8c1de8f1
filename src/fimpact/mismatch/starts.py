"""The state at the start of each window, as far as the measurements show it, and the noise that they carry."""

from collections.abc import Iterator

import mujoco
import numpy as np

from fimpact.mismatch.simulate import Simulator
from fimpact.mismatch.windows import Windows
from fimpact.recordings import Recording, Run

WIDTHS = (41, 31, 21, 15, 11, 7, 5)  # samples in the local fit of position and speed, widest first
FITS = 1.5  # standard deviations of noise: the residual up to which a local fit follows the signal
ROUND_OFF = 1e-3  # of the median step; what is smaller is no quantum
DIFFERENCES = 3  # order; a smooth signal hardly has any, noise has all
JOINTPOS, JOINTVEL = mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtSensor.mjSENS_JOINTVEL
FRAMEPOS, FRAMEQUAT = mujoco.mjtSensor.mjSENS_FRAMEPOS, mujoco.mjtSensor.mjSENS_FRAMEQUAT
BODIES = (mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_XBODY)
SPREAD = 1.482602218505602  # standard deviations in a median absolute deviation of a normal variable


def start_states(simulator: Simulator, windows: Windows, noise: np.ndarray, held_out: bool = False) -> tuple:
    """First guesses of qpos (w, nq) and qvel (w, nv): measured joints and poses by a local cubic, others as given
    for the start of the run, or as in the model's reference configuration."""
    model, recording = simulator.base, simulator.recording
    qpos = np.tile(model.qpos0, (len(windows.runs), 1))
    qvel = np.zeros((len(windows.runs), model.nv))
    for row, (run, first) in enumerate(_places(recording, windows, held_out)):
        if first == 0 and run.qpos is not None:
            qpos[row], qvel[row] = run.qpos, run.qvel
        else:
            _measured_state(model, recording, run.measured, first, noise, qpos[row], qvel[row])
    return qpos, qvel


def start_spread(recording: Recording, windows: Windows, held_out: bool = False) -> np.ndarray:
    """Prior standard deviation of the states at the start of windows, (w, 2 nv); inf where nothing is known of them."""
    told = [first == 0 and run.opens for run, first in _places(recording, windows, held_out)]
    return np.where(np.array(told)[:, None], recording.start_sd, np.inf)


def _places(recording: Recording, windows: Windows, held_out: bool) -> Iterator[tuple[Run, int]]:
    """Run and first sample of each window."""
    runs = recording.held_out if held_out else recording.training
    return ((runs[which], first) for which, first in zip(windows.runs, windows.first, strict=True))


def _measured_state(model, recording: Recording, measured, first: int, noise, qpos, qvel) -> None:
    quaternion = {}
    for column, channel in enumerate(recording.channels):
        name, _, part = channel.removesuffix("]").partition("[")
        sensor, part = model.sensor(name), int(part or 0)
        place = place_of(model, sensor, part)
        if place is None:
            continue
        found = local_fit(measured[:, column], first, recording.period, noise[column])
        if found is None:
            continue
        (value, slope), (kind, position, speed) = found, place
        if kind == "quaternion":
            quaternion.setdefault(position - part, {})[part] = (value, slope)
        elif kind == "speed":
            qvel[speed] = value
        else:
            qpos[position] = value
            qvel[speed] = slope
    for address, parts in quaternion.items():
        _pose(model, qpos, qvel, address, parts)


def place_of(model, sensor, part: int) -> tuple[str, int, int] | None:
    """What a sensor component shows: ("position" | "speed" | "quaternion", index in qpos, index in qvel)."""
    kind, owner = mujoco.mjtSensor(sensor.type[0]), sensor.objid[0]
    if kind in (JOINTPOS, JOINTVEL):
        joint = model.joint(owner)
        return ("position" if kind == JOINTPOS else "speed", joint.qposadr[0], joint.dofadr[0])
    if kind not in (FRAMEPOS, FRAMEQUAT):
        return None
    body = model.body(owner) if mujoco.mjtObj(sensor.objtype[0]) in BODIES else None
    if body is None or body.jntnum[0] != 1 or model.jnt_type[body.jntadr[0]] != mujoco.mjtJoint.mjJNT_FREE:
        return None
    joint = model.joint(body.jntadr[0])
    if kind == FRAMEPOS:
        return ("position", joint.qposadr[0] + part, joint.dofadr[0] + part)
    return ("quaternion", joint.qposadr[0] + 3 + part, joint.dofadr[0] + 3)


def _pose(model, qpos, qvel, address: int, parts: dict) -> None:
    if len(parts) < 4:
        return
    value, slope = np.array([parts[i] for i in range(4)]).T
    size = np.linalg.norm(value)
    if not size > 0:
        return
    value, slope = value / size, slope / size
    conjugate = value * [1, -1, -1, -1]
    spin = np.empty(4)
    mujoco.mju_mulQuat(spin, conjugate, slope)  # body-frame angular velocity is twice the vector part
    joint = next(j for j in range(model.njnt) if model.jnt_qposadr[j] + 3 == address)
    qpos[address : address + 4] = value
    qvel[model.jnt_dofadr[joint] + 3 : model.jnt_dofadr[joint] + 6] = 2 * spin[1:]


def local_fit(signal: np.ndarray, index: int, period: float, noise: float) -> tuple[float, float] | None:
    """Value and slope (per s) at `index` of the widest local cubic whose residual is no more than noise, through the
    nearest samples that there are, which may be slower than the grid; None where there are none."""
    known = np.flatnonzero(np.isfinite(signal))
    if len(known) < 2:
        return (float(signal[known[0]]), 0.0) if len(known) else None
    nearest = int(np.searchsorted(known, index))
    for samples in WIDTHS:
        first = int(np.clip(nearest - samples // 2, 0, max(len(known) - samples, 0)))
        rows = known[first : first + samples]
        time, piece = (rows - index) * period, signal[rows]
        scale = np.abs(time).max()
        fit = np.polynomial.Polynomial(
            np.polynomial.polynomial.polyfit(time / scale, piece, min(3, max(len(time) - 2, 1)))
        )
        if np.sqrt(np.mean((fit(time / scale) - piece) ** 2)) < FITS * noise:
            break
    return float(fit(0.0)), float(fit.deriv()(0.0) / scale)


def noise_level(recording: Recording) -> np.ndarray:
    """Standard deviation of each channel's noise, (ny,), as given or from third differences, never from a model.

    Half-resolved quantisation counts: the level is at least the quantum / sqrt(12).

    Raises:
        ValueError: a channel never changes, so that nothing can be told.
    """
    level = np.array(recording.noise, float)
    factor = np.sqrt(20.0)  # of third differences of white noise: 1 + 9 + 9 + 1
    for column in np.flatnonzero(~np.isfinite(level)):
        rough, quanta = [], []
        for run in recording.runs:
            signal = run.measured[:, column]
            known = np.isfinite(signal)
            if np.isfinite(np.diff(signal, DIFFERENCES)).sum() < known.sum() / 2:
                signal = signal[known]  # slower than the grid: differences between samples of its own
            rough.append(np.diff(signal, DIFFERENCES))
            steps = np.abs(np.diff(signal))
            quanta.append(steps[steps > 0])
        rough, quanta = np.concatenate(rough), np.concatenate(quanta)
        rough = rough[np.isfinite(rough)]
        quantum = quanta[quanta > ROUND_OFF * np.median(quanta)].min() if len(quanta) else 0.0
        floor = quantum / np.sqrt(12)
        spread = SPREAD * np.median(np.abs(rough)) / factor if len(rough) else 0.0
        level[column] = max(spread, floor)
        if not level[column]:
            raise ValueError(f"the noise of '{recording.channels[column]}' is 0 by its samples; declare its `noise`")
    return level
