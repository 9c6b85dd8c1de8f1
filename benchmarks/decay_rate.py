"""Rate at which a swinging pendulum loses energy, as recorded and as a diagnosis has it, from large to small amplitude.

python benchmarks/decay_rate.py config/recordings/arm_pendulum.yaml DIAGNOSIS.json --window 8 --data FOLDER

Of one hinge and its angle. The rate is that of viscous friction which would lose as much in each window, d / I =
-dE / (I integral of qvel^2), in 1/s, between its first and last turning point on one side; windows are simulated in one
go from the state fitted to them.
"""

import numpy as np
from diagnosed import told

from fimpact.diagnosis.held_out import starts_of
from fimpact.simulation.horizon import predict_windows
from fimpact.simulation.windows import cut
from fimpact.smoothing.prepare import prepare


def speeds(angle: np.ndarray, period: float) -> np.ndarray:
    """Of angles (w, T), rad/s."""
    return np.gradient(angle, period, axis=1)


def potential(angle: np.ndarray, period: float) -> tuple[float, float]:
    """a and b of qacc = a sin + b cos of the angle, beside friction: the potential is a cos - b sin, per inertia."""
    speed = speeds(angle, period)
    inner = (slice(None), slice(2, -2))
    columns = [np.sin(angle), np.cos(angle), speed, np.sign(speed)]
    rows = np.stack([column[inner].ravel() for column in columns], 1)
    found = np.linalg.lstsq(rows, speeds(speed, period)[inner].ravel(), rcond=None)[0]
    return found[0], found[1]


def rates(angle: np.ndarray, period: float, a: float, b: float) -> np.ndarray:
    """Of each window of angles (w, T), (w,), 1/s."""
    speed, found = speeds(angle, period), []
    energy = speed**2 / 2 + a * np.cos(angle) - b * np.sin(angle)
    for own, fast in zip(energy, speed, strict=True):
        turning = np.flatnonzero((fast[2:-3] > 0) & (fast[3:-2] <= 0)) + 2
        if len(turning) < 2:
            raise SystemExit("a window turns less than twice on one side; give a longer --window")
        first, last = turning[0], turning[-1]
        found.append((own[first] - own[last]) / (fast[first:last] ** 2).sum() / period)
    return np.array(found)


def main() -> None:
    """A line for each window of training and held-out runs: its amplitude, and the rates."""
    recording, tried, options = told(__doc__, window=(8.0, "s"))
    if len(recording.channels) != 1:
        raise SystemExit(f"one angle must be measured, got {', '.join(recording.channels)}")
    prepared, runs = prepare(recording), (*recording.training, *recording.held_out)
    simulator = prepared.track.simulator
    starts = starts_of(recording, runs, prepared.noise, simulator)
    windows = cut(runs, round(options.window / recording.period))
    recorded = windows.measured[:, :, 0]
    a, b = potential(recorded, recording.period)
    columns = {"recorded": rates(recorded, recording.period, a, b)}
    for label, hypothesis in tried.items():
        angles = predict_windows(simulator, hypothesis, windows, starts, prepared.noise)[0][:, :, 0]
        columns[label] = rates(angles, recording.period, a, b)
    for k, swing in enumerate(np.ptp(recorded, axis=1) / 2):
        print(f"{swing:.2f} rad: " + ", ".join(f"{label} {rate[k]:.4f}" for label, rate in columns.items()))


if __name__ == "__main__":
    main()
