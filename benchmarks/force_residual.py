"""How much of the driving force a diagnosis leaves unexplained, by inverse dynamics on the held-out runs.

python benchmarks/force_residual.py config/recordings/emps.yaml results/recordings/emps/diagnosis.json --data FOLDER

For rigs whose every joint is measured and driven. Positions are low-passed without phase, far above the cutoff, and
differentiated; the force that the recorded motion would need beyond what the model has is low-passed at the cutoff and
divided by the driving force, root mean squares both. This is how such rigs are judged where they were published;
diagnoses themselves never use it.
"""

import mujoco
import numpy as np
from diagnosed import told
from scipy.signal import butter, filtfilt

from fimpact.added_force import law_force
from fimpact.cases import kinds
from fimpact.mismatch.simulate import Hypothesis, Simulator

EDGE = 0.1  # s at either end, where a filter has no neighbours
ABOVE, FASTEST = 5.0, 0.8  # cutoff of positions over that of forces; at most, of half the sampling rate


def missing_force(simulator: Simulator, hypothesis: Hypothesis, motion, ctrl) -> tuple[np.ndarray, np.ndarray]:
    """Force that the motion (qpos, qvel, qacc) needs beyond the model's, and that of the drives, (T, nv) each."""
    model, (qpos, qvel, qacc) = simulator.model(hypothesis), motion
    time, acting = np.arange(len(qpos)) * simulator.recording.period, hypothesis.placed
    pull = law_force(model, acting, qpos, qvel, ctrl, time)
    data, inertia = mujoco.MjData(model), np.empty((model.nv, model.nv))
    missing, driving = np.empty_like(qvel), np.empty_like(qvel)
    for i in range(len(qpos)):
        data.qpos[:], data.qvel[:], data.ctrl[:], data.qfrc_applied[:] = qpos[i], qvel[i], ctrl[i], pull[i]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, inertia)
        missing[i], driving[i] = inertia @ (qacc[i] - data.qacc), data.qfrc_actuator
    return missing, driving


def refuse(simulator: Simulator, recording, answer: Hypothesis) -> None:
    """Stop where the motion is not known, or an effect does not act as a force."""
    if len(recording.channels) != simulator.base.nv or any(np.isnan(r.measured).any() for r in recording.held_out):
        raise SystemExit("every joint must be measured, without gaps, for inverse dynamics")
    sensors = [simulator.base.sensor(channel.partition("[")[0]) for channel in recording.channels]
    shown = [(int(sensor.type[0]), int(sensor.objid[0])) for sensor in sensors]
    if shown != [(kinds.JOINTPOS, joint) for joint in range(simulator.base.njnt)]:
        raise SystemExit("the measurements must be the positions of the joints, in the order of the MJCF")
    for placed in answer.placed:
        if placed.effect.enters in ("command", "measurement"):
            raise SystemExit(f"{placed.name} acts on a {placed.effect.enters}, not as a force; it cannot be judged so")


def main() -> None:
    """One line per held-out run and joint."""
    recording, tried, options = told(__doc__, cutoff=(20.0, "Hz"))
    simulator, step = Simulator(recording), recording.period
    slow, edge = butter(4, 2 * options.cutoff * step), round(EDGE / step)
    fast = butter(4, min(2 * ABOVE * options.cutoff * step, FASTEST))
    refuse(simulator, recording, tried["answer"])
    for run in recording.held_out:
        qpos = filtfilt(*fast, run.measured, axis=0)
        qvel = np.gradient(qpos, step, axis=0)
        motion = qpos, qvel, np.gradient(qvel, step, axis=0)
        # A command is held from its sample on: at the sample itself its mean with the one before acts.
        ctrl = (run.ctrl + np.concatenate([run.ctrl[:1], run.ctrl[:-1]])) / 2
        for label, hypothesis in tried.items():
            both = missing_force(simulator, hypothesis, motion, ctrl)
            missing, driving = (np.linalg.norm(filtfilt(*slow, x, axis=0)[edge:-edge], axis=0) for x in both)
            shares = zip(recording.channels, missing / driving, strict=True)
            print(f"{run.name}, {label}: {', '.join(f'{name} {share:.1%}' for name, share in shares)}")


if __name__ == "__main__":
    main()
