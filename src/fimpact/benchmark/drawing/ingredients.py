"""What every draw of a case needs: what is wrong without being an effect, how visible an effect is, the recording."""

from dataclasses import replace

import numpy as np

from fimpact.benchmark.drawing.effect_size import Stage, Trace, Unfit, concealment, set_stage, visibility
from fimpact.benchmark.drawing.motions import Motion
from fimpact.benchmark.planting.ground_truth import play
from fimpact.benchmark.planting.out_of_catalogue import known
from fimpact.benchmark.rigs.rig import CLOCK, Rig
from fimpact.benchmark.truth import Planted, Truth, clean, logged, measure, slips, world_of
from fimpact.recordings import Recording, Run

UNSTABLE = 10.0  # times what coarser, implicit steps read at most


def errors_of(rng, rig: Rig) -> np.ndarray:
    """By how much the unknowns are off, (p,)."""
    errors = rng.normal(size=len(rig.unknowns)) * [u.sd for u in rig.unknowns]
    most = [min(0.2, 2 * u.sd) if u.sd > 0.05 else 2 * u.sd for u in rig.unknowns]
    return np.clip(errors, *np.array([[-1], [1]]) * most)


def nuisance_of(rng, rig: Rig, motion: Motion, errors: np.ndarray) -> tuple[Stage, dict]:
    """Everything that is wrong with the naive model without being an effect."""
    start = motion.start + slips(rig) * rng.standard_normal(motion.start.shape)
    offset = rng.uniform(0, CLOCK, len(start))
    correlation, raised = rng.uniform(0.05, 0.1), rng.uniform(0.05, 0.2)
    stage = set_stage(rig, motion, errors, start, correlation, raised)
    return stage, {
        "errors": tuple(errors.tolist()),
        "start": tuple(map(tuple, start.tolist())),
        "offset": tuple(offset.tolist()),
        "noise": tuple(rig.sd.tolist()),
        "disturbance": stage.disturbance,
        "correlation": correlation,
    }


def form_of(rng, stage: Stage, name: str, site: str) -> tuple[dict, float]:
    """Numbers that stay fixed while an effect's size is sought, and its sign."""
    plant = known(name)
    return plant.shape(rng, stage.rig, stage.motion, site), -1.0 if plant.signed and rng.random() < 0.5 else 1.0


def together(stage, traces) -> dict:
    """Visibility of everything planted, as one."""
    if not traces:
        return {"lam": 0.0, "kappa": 0.0, "kappa_unknown": 0.0, "cosine": 0.0, "left": 0.0}
    whole = replace(traces[0], change=sum(t.change for t in traces))
    kappa, unknown = concealment(stage, whole)
    cosine, left = visibility(stage, *traces).left(0, 1) if len(traces) == 2 else (0.0, 0.0)
    lam = float(visibility(stage, whole).size[0])
    return {"lam": lam, "kappa": kappa, "kappa_unknown": unknown, "cosine": cosine, "left": left}


def planted(stage: Stage, site: str, found: Trace, name: str) -> Planted:
    lam, (kappa, unknown) = float(visibility(stage, found).size[0]), concealment(stage, found)
    mode = known(name).mode if stage.rig.naive.npair else "free"
    values = {key: float(value) for key, value in found.values.items()}
    return Planted(name, site, values, lam, kappa, unknown, mode)


def check_stable(stage: Stage, truth: Truth, motion: Motion, recording: Recording) -> None:
    """Unfit where the recording reads far more than a simulation by other steps and another integrator: a stiff effect
    that makes the finer one unstable is no physics."""
    other = play(world_of(truth, stage.rig), stage.start, motion.ctrl).samples
    largest = np.abs(other).max((0, 1)) + stage.rig.sd
    read = np.abs([run.measured for run in recording.runs]).max((0, 1))
    # What diverged is no number, and below nothing.
    if not (np.isfinite(read) & (read <= UNSTABLE * largest)).all():
        raise Unfit("the simulation is unstable")


def record(truth: Truth, motion: Motion) -> Recording:
    """The recording that this truth and these motions give."""
    rig = truth.robot
    played, _ = clean(truth, np.array(truth.start), motion.ctrl, truth.offset, stream=0)
    measured, ctrl = measure(truth, played.samples, stream=0), logged(truth, motion.ctrl, played.states, stream=0)
    nv, believed = rig.naive.nv, np.isfinite(rig.start_sd).all()
    runs = tuple(
        Run(
            f"run_{i + 1:02d}",
            ctrl[i],
            measured[i],
            bool(motion.held_out[i]),
            motion.start[i, :nv] if believed else None,
            motion.start[i, nv:] if believed else None,
        )
        for i in range(len(measured))
    )
    unknown_noise = np.full(len(rig.channels), np.nan)
    return Recording(rig.xml, "", rig.period, rig.channels, runs, rig.unknowns, unknown_noise, rig.start_sd, rig.window)
