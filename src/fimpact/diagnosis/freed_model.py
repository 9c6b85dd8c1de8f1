"""Everything freed: what users do who do not know where something is missing, and the model to beat."""

from dataclasses import replace

import mujoco

from fimpact.recordings import Recording, Unknown
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.prepare import Prepared
from fimpact.smoothing.smoother import smooth
from fimpact.smoothing.states import States

OF_JOINTS = ("damping", "frictionloss", "armature")
PATIENCE = 5  # rounds without a better fit
TURNS_OR_SLIDES = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def freed(recording: Recording) -> Recording:
    """`recording` with more unknowns: what any hinge or slide can lack, and the friction of every contact."""
    model = Simulator(recording).base
    joints = [model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] in TURNS_OR_SLIDES]
    touching = [model.geom(i).name for i in range(model.ngeom) if model.geom_contype[i] | model.geom_conaffinity[i]]
    wanted = [(field, joint) for field in OF_JOINTS for joint in joints]
    wanted += [("pair_friction", model.pair(i).name) for i in range(model.npair)]
    wanted += [("friction", geom) for geom in touching if not model.npair]
    known = {(unknown.field, unknown.site) for unknown in recording.unknowns}
    extra = tuple(Unknown(field, site) for field, site in wanted if site and (field, site) not in known)
    return replace(recording, unknowns=recording.unknowns + extra)


def fit_freed(prepared: Prepared, begun: States) -> tuple[Simulator, Hypothesis]:
    """Fit the naive model with everything freed at once, by the same estimator as all else.

    Args:
        begun: states of the training runs to begin with, (N,).
    """
    recording = freed(prepared.track.recording)
    coarse = round(Simulator(prepared.track.recording).base.opt.timestep / prepared.track.simulator.base.opt.timestep)
    track = Track(Simulator(recording, max(coarse, 1), prepared.proving.apart), prepared.track.runs)
    # So much freed often goes astray after some rounds: a user would take the best fit.
    found = smooth(track, begun, prepared.noise, patience=PATIENCE)
    return track.simulator, Hypothesis(found.theta)
