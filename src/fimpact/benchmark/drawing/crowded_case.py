"""Drawing a crowd: friction and rotors at every joint, and one odd effect that is worth a share of the force."""

from collections.abc import Callable
from dataclasses import replace
from math import ceil

import numpy as np

from fimpact.benchmark.drawing.detectability import equivalent_force, oracle_sd
from fimpact.benchmark.drawing.effect_size import (
    NEAR,
    SEARCHES,
    Stage,
    Trace,
    Unfit,
    planted_windows,
    trace,
    visibility,
)
from fimpact.benchmark.drawing.ingredients import (
    check_stable,
    errors_of,
    form_of,
    nuisance_of,
    planted,
    record,
    together,
)
from fimpact.benchmark.drawing.motions import draw_motion
from fimpact.benchmark.drawing.tangents import cut, models, predict, pulses
from fimpact.benchmark.planting.crowd import ODD, TYPICAL, Member, bare, draw_members, filled
from fimpact.benchmark.planting.ground_truth import new_world, play
from fimpact.benchmark.planting.out_of_catalogue import known
from fimpact.benchmark.planting.planted_effects import PLANTS
from fimpact.benchmark.rigs.registry import RIGS, rig_of
from fimpact.benchmark.rigs.rig import Rig
from fimpact.benchmark.site_equivalence import places
from fimpact.benchmark.truth import Planted, Truth
from fimpact.recordings import Recording

WILD = 1e6  # non-centrality beyond which nobody would call the two the same motion
MOST = 3.0  # of the logarithm of the size, in one step
Share = Callable[[np.ndarray], float]  # of a trace, the share of the force that it is worth
LONG = 0.005  # s, the step for which `Plant.stiff` is meant


def draw_crowd(rng, index, kind, system, target, attempt, seed) -> tuple[Recording, Truth]:
    """Friction and rotors at every joint, and one odd effect that an oracle sees although all of those are freed."""
    rig, odd, site = _choose_odd(rng, index, attempt, system)
    members, naive = draw_members(rig, rng), bare(rig)
    full = filled(naive, members)
    errors = errors_of(rng, naive)
    both = np.r_[errors, np.zeros(len(members))]
    motion = draw_motion(full, rng, model=models(full, both))
    stage, nuisance = nuisance_of(rng, replace(full, coarse=full.coarse * _finer(full, odd)), motion, both)
    loose = filled(naive, tuple(m for m in members if m.name != "coulomb"))
    share = _share(stage, loose, odd, site)
    found, worth = _odd(stage, odd, site, form_of(rng, stage, odd, site), target, share)
    effects = _crowd(stage, members, planted(stage, site, found, odd), found, worth)
    nuisance["errors"] = tuple(errors.tolist())
    about = together(stage, (found,)) | nuisance
    truth = Truth(kind=kind, system=rig.name, effects=effects, rival=None, seed=seed, **about)
    recording = record(truth, motion)
    check_stable(replace(stage, rig=replace(naive, coarse=stage.rig.coarse)), truth, motion, recording)
    return recording, truth


def _finer(rig: Rig, name: str) -> int:
    """By how much finer steps than the naive model's a size is sought: hard stops shiver at long ones."""
    return max(1, ceil(known(name).stiff * rig.naive.opt.timestep / LONG))


def _odd(
    stage: Stage, name: str, site: str, form, target: float, share: Callable[[np.ndarray], float]
) -> tuple[Trace, float]:
    """The odd effect at a size that is worth `target` of the force at its place, and its worth. Raises Unfit."""
    (shape, sign), kind = form, known(name)
    size, most = kind.span(stage.rig)
    for _ in range(SEARCHES):
        values = kind.values(sign * size, **shape)
        worth = share(planted_windows(stage, name, site, values)[2])
        if abs(np.log(max(worth, 1e-9) / target)) < NEAR:
            found = trace(stage, name, site, sign * size, values)
            if visibility(stage, found).size[0] > WILD:
                raise Unfit(f"{name} at {site} shakes the robot")
            return found, worth
        size = min(size * float(np.exp(np.clip(np.log(target / max(worth, 1e-9)), -MOST, MOST))), most)
    raise Unfit(f"no size of {name} at {site} is worth {target:.2g} of the force there")


def _choose_odd(rng, index, attempt, system) -> tuple[Rig, str, str]:
    """A rig, by turns, and an effect, by turns in each rig, with its place; where it finds no fit the next is tried."""
    rigs = [rig for rig in ([rig_of(system)] if system else RIGS.values()) if rig.name in TYPICAL]
    if not rigs:
        raise ValueError(f"nothing of kind 'crowd' can act in {system!r}; there are {', '.join(TYPICAL)}")
    turn, place = divmod(index, len(rigs))
    rig = rigs[place]
    names = [name for name in ODD if rig.name in PLANTS[name].sites]
    name = names[(turn + attempt) % len(names)]
    return rig, name, str(rng.choice(PLANTS[name].sites[rig.name]))


def _crowd(stage: Stage, members: tuple[Member, ...], odd: Planted, found: Trace, worth: float) -> tuple[Planted, ...]:
    """What is planted: friction that falls with speed stands in the place of friction that does not."""
    spread = oracle_sd(stage.rig, found.tangent, stage.white, found.change)[-len(members) :]
    crowd = [
        Planted(m.name, m.site, m.values, float(sd**-2.0), 0.0, 0.0, "free" if not stage.rig.naive.npair else "any")
        for m, sd in zip(members, spread, strict=True)
    ]
    if odd.name == "stribeck":
        (dry,) = (e for e in crowd if (e.name, e.site) == ("coulomb", odd.site))
        crowd.remove(dry)
        odd = replace(odd, values=odd.values | {"coulomb": dry.values["friction"] + odd.values["coulomb"]})
    return (*crowd, replace(odd, worth=worth))


def _share(stage: Stage, loose: Rig, name: str, site: str) -> Share:
    """Gives the force of an odd effect at its place, of several joints at that where it is most, over what motors give
    there.

    A joint that rubs and rests hides any force: what a force would show is asked of the `loose` rig, without dry
    friction, along the same motion.
    """
    rig, runs = stage.rig, np.flatnonzero(~stage.motion.held_out)
    at = places(rig.naive, rig.channels, site.partition("<-")[0])
    own = [i for i, joint in enumerate(rig.driven) if joint in at] or list(range(len(rig.driven)))
    dofs = [rig.naive.joint(joint).dofadr[0] for joint in rig.driven]
    states = play(new_world(rig, stage.errors, fine=False), stage.start[runs], stage.motion.ctrl[runs]).states
    windows, model = cut(rig, stage.motion, states, runs), models(loose, stage.errors[: len(loose.unknowns)])
    push = pulses(loose, model, windows, predict(loose, model, windows.start, windows.ctrl))
    applied = _applied(stage, states, runs)
    return lambda change: float((equivalent_force(rig, push, change)[dofs] / applied)[own].max())


def _applied(stage: Stage, states: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Root mean square of what each motor gives in the training runs, (nu,), N m."""
    rig, ctrl = stage.rig, stage.motion.ctrl[runs]
    if rig.serves():
        model, nv = rig.naive, rig.naive.nv
        dofs = np.array([model.joint(name).dofadr[0] for name in rig.driven])
        gains, (stiff, slow) = model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1:3].T
        ctrl = gains * ctrl + stiff * states[:, :, dofs] + slow * states[:, :, nv + dofs]
    return np.sqrt(np.mean(ctrl**2, axis=(0, 1)))
