"""Curves: what a force without a name could depend on, as smooth bumps over the range of anything that goes with it."""

import numpy as np
from scipy.cluster.vq import kmeans2

from fimpact.mismatch.pulses import Pulses

BUMPS, SPOTS = 5, 8  # smooth curves over the range of a regressor, and over the postures that a robot took
SPELLS, WAVES = 12, range(2, 9)  # pieces of the longest run in which a force may act alone, and periods in it


def curves(found: Pulses) -> list[tuple[int, str, np.ndarray]]:
    """(degree of freedom, what the force goes with, force (w, BINS)): one's own position and speed, time, friction over
    position and time, every command, the own command over position and time, what swings unseen, and while in contact
    direction of motion and position.
    """
    out = []
    for dof in range(len(found.dofs)):
        own = [*_alone(found, dof), *_driving(found, dof), *_touching(found, dof)]
        out += [(dof, "swing", shape) for shape in found.swing[:, :, dof].transpose(2, 0, 1)]
        out += [(dof, name, shape) for name, shape in own]
    return out


def spells(found: Pulses) -> list[tuple[float, np.ndarray]]:
    """(s after a run began, sensitivity (w, m) to a force on one degree of freedom for a moment, alike in all runs)."""
    length = found.time.max() * (1 + 1e-9) / SPELLS
    now = [(k, ((found.time / length).astype(int) == k) * 1.0) for k in range(SPELLS)]
    return [((k + 0.5) * length, found.along(dof, on)) for k, on in now for dof in range(len(found.dofs))]


def waves(found: Pulses) -> list[tuple[int, str, float, np.ndarray]]:
    """(degree of freedom, "wave" or "command wave", period in s, force (w, BINS)): what comes and goes, alike in all
    runs, as a force and as a strength of the own command."""
    longest, out = found.time.max(), []
    shapes = [(longest / k, turn(2 * np.pi * k / longest * found.time)) for k in WAVES for turn in (np.cos, np.sin)]
    for dof in range(len(found.dofs)):
        driving = zip(found.ctrl.transpose(2, 0, 1), found.driven, strict=True)
        own = [("wave", 1.0), *(("command wave", u) for u, driven in driving if driven == dof)]
        out += [(dof, kind, period, u * wave) for kind, u in own for period, wave in shapes]
    return out


def field(found: Pulses) -> list[np.ndarray]:
    """Sensitivities, (w, m), to forces on each degree of freedom in each of the postures that the robot took."""
    return [found.along(dof, spot) for spot in spots(found.qpos) for dof in range(len(found.dofs))]


def bumps(x: np.ndarray) -> list[np.ndarray]:
    """Smooth bumps over the range of `x`, each of its shape."""
    centres = np.quantile(x, (np.arange(BUMPS) + 0.5) / BUMPS)
    width = max(np.diff(centres).mean(), 1e-9)
    return [np.exp(-0.5 * ((x - centre) / width) ** 2) for centre in centres]


def spots(x: np.ndarray) -> list[np.ndarray]:
    """Smooth bumps, (w, n) each, around the middles of clusters of `x`, (w, n, d), that is in any units."""
    flat = x.reshape(-1, x.shape[2])
    flat = (flat - flat.mean(0)) / np.maximum(flat.std(0), 1e-12)
    taken = np.unique(flat, axis=0)
    centres = kmeans2(taken, SPOTS, minit="++", rng=0)[0] if len(taken) > SPOTS else taken
    apart = np.linalg.norm(centres[:, None] - centres, axis=2) + np.diag(np.full(len(centres), np.inf))
    width = np.median(apart.min(1)) if len(centres) > 1 else 1.0
    near = [np.exp(-0.5 * ((flat - centre) ** 2).sum(1) / width**2) for centre in centres]
    return [bump.reshape(x.shape[:2]) for bump in near]


def _over(found: Pulses, dof: int) -> dict[str, np.ndarray]:
    own = {"position": found.qpos[..., dof]} if found.qpos.shape[2] == found.qvel.shape[2] else {}
    return {"time": found.time, **own}


def _alone(found: Pulses, dof: int) -> list[tuple[str, np.ndarray]]:
    against, over = np.sign(found.qvel[..., dof]), _over(found, dof)
    regressors = {"speed": found.qvel[..., dof], **over}
    free = [(name, bump) for name, x in regressors.items() for bump in bumps(x)]
    return free + [(f"friction over {name}", against * bump) for name, x in over.items() for bump in bumps(x)]


def _driving(found: Pulses, dof: int) -> list[tuple[str, np.ndarray]]:
    ctrl, over = found.ctrl.transpose(2, 0, 1), _over(found, dof)
    own = [command for command, driven in zip(ctrl, found.driven, strict=True) if driven == dof]
    changing = [(f"command over {name}", u * bump) for u in own for name, x in over.items() for bump in bumps(x)]
    return [("commands", command) for command in ctrl] + changing


def _touching(found: Pulses, dof: int) -> list[tuple[str, np.ndarray]]:
    touching, over = found.mode != "free", _over(found, dof)
    if not touching.any() or touching.all():
        return []
    shapes = [("contact", touching * 1.0), ("contact", touching * np.sign(found.qvel[..., dof]))]
    places = bumps(over["position"]) if "position" in over else []
    return shapes + [("contact over position", touching * bump) for bump in places]
