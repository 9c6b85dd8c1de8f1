"""What is left without a name: how much of the force, where, and whether it follows from the state."""

from typing import Any

import numpy as np

from fimpact.deciding import LOUD
from fimpact.diagnosis.held_out import Proof
from fimpact.effects.base import words
from fimpact.selection.explanation import Explanation
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.prepare import Prepared
from fimpact.smoothing.smoother import Smoothed, smooth
from fimpact.smoothing.states import States

KINDS = {
    "": "a force that follows", "friction": "friction that follows", "damping": "damping that follows",
    "gain": "a motor's gain that follows", "push": "a push on what it carries that follows",
    "slide": "something loose in what it carries, whose slide follows",
    "sway": "the sway of what it stands on, which follows",
}  # fmt: skip
FOLLOWED = {
    "time": "the time in the run", "contact": "whether anything touches",
    **{f"pull along {axis}": f"how it is pulled along its {axis}-axis" for axis in "xyz"},
    **{f"push along {axis}": f"how the mechanism pushes itself off along the world's {axis}-axis" for axis in "xyz"},
}  # fmt: skip
POINTS = 60  # of the picture


def missing_rows(found: Explanation) -> list[dict[str, Any]]:
    """Root mean square missing force of each degree of freedom before and after, and what is applied."""
    model = found.final.track.model
    rows = []
    for dof in range(model.nv):
        rows.append(
            {
                "joint": dof_name(model, dof),
                "unit": "N" if _slides(model, dof) else "N m",
                "naive": _rms(found.naive.tau[:, dof]),
                "left": _rms(found.final.tau[:, dof]),
                "applied": float(found.scales.force[dof]),
            }
        )
    return rows


def remainder(prepared: Prepared, found: Explanation, proof: Proof | None, brief: bool = False) -> dict[str, Any]:
    """Say what is left: a sentence, whether something unnamed is missing, and the held-out rows, unless `brief`."""
    rows = missing_rows(found)
    held = [] if brief or proof is None else held_out_rows(prepared, found, proof)
    worst = max(rows, key=lambda row: row["left"] / max(row["applied"], 1e-12))
    share, left = worst["left"] / max(worst["applied"], 1e-12), found.left
    unnamed = not found.final.placed and (left.dof is not None or (_stands_out(proof) and share > LOUD))
    said = []
    if found.unfitted:
        unnamed = True
        best = max(found.unfitted, key=lambda trial: trial.gain)
        said.append(
            f"Nearest to it is {words(best.option.name)} ({best.share:.0%} of what was missing at "
            f"{rows[best.place[1]]['joint']}), but no fit with it settles."
        )
    if left.dof is not None:
        kind, _, what = (left.follows or "").rpartition(" with ")
        what = f"{KINDS[kind]} {FOLLOWED.get(what, f'its {what}')}"
        place = rows[left.dof]["joint"]
        what += f", most of all at {left.loudest}" if left.loudest else ""
        said.append(f"Left without a name at {place}: {what} ({left.share:.0%} of what was missing there).")
    if share > LOUD and (found.final.placed or unnamed):
        loud = f"{worst['left']:.2g} {worst['unit']}"
        said.append(f"What has no name is {share:.0%} of the force at {worst['joint']} ({loud}).")
    joint = worst["joint"] if left.dof is None else rows[left.dof]["joint"]
    return {
        "sentence": " ".join(said), "joint": joint, "share": share, "unnamed": unnamed, "follows": left.follows,
        "held_out": held,
    }  # fmt: skip


def _stands_out(proof: Proof | None) -> bool:
    if proof is None:
        return True
    errors = [row["error_naive"] for row in proof.runs]
    return any(e is None or e > 2 * proof.noise_floor for e in errors)


def held_out_rows(prepared: Prepared, found: Explanation, proof: Proof) -> list[dict[str, Any]]:
    """Missing force of each held-out run under the naive and the final model, smoothed with their own noise levels."""
    recording = prepared.track.recording
    track = Track(prepared.track.simulator, recording.held_out)
    begun = States(*(np.concatenate([getattr(s, part) for s in proof.starts]) for part in ("qpos", "qvel", "act")))
    pair = [_smoothed(track, begun, prepared.noise, fit) for fit in (found.naive, found.final)]
    applied = found.scales.force
    rows = []
    for run, part in zip(recording.held_out, track.slices(), strict=True):
        for dof in range(track.model.nv):
            rows.append(
                {
                    "run": run.name,
                    "joint": dof_name(track.model, dof),
                    "unit": "N" if _slides(track.model, dof) else "N m",
                    "naive": _rms(pair[0].tau[part][:, dof]),
                    "left": _rms(pair[1].tau[part][:, dof]),
                    "applied": _applied(track, part, dof, applied),
                }
            )
    return rows


def _smoothed(track: Track, begun, noise, fit: Smoothed) -> Smoothed:
    return smooth(track, begun, noise, fit.placed, fit.priors, theta=fit.theta, rounds=4, frozen=True)


def _applied(track: Track, part: slice, dof: int, typical: np.ndarray) -> float:
    """Root mean square force of the motors on a joint in one run, or what is typical where none drives it."""
    model, joint = track.model, int(track.model.dof_jntid[dof])
    motors = np.flatnonzero((model.actuator_trntype == 0) & (model.actuator_trnid[:, 0] == joint))
    plain = [m for m in motors if model.actuator_biastype[m] == 0]
    if not plain:
        return float(typical[dof])
    gains = model.actuator_gainprm[plain, 0] * model.actuator_gear[plain, 0]
    return _rms(track.ctrl[part, 0][:, plain] @ gains)


def picture(prepared: Prepared, found: Explanation) -> dict[str, Any]:
    """The missing force of the joint that lacked most against its speed, and what the found laws make of it."""
    naive, final = found.naive, found.final
    share = (naive.tau**2).mean(0) / np.maximum(found.scales.force**2, 1e-300)
    dof = int(np.argmax(share))
    order = np.argsort(naive.states.qvel[:, dof])
    groups = [g for g in np.array_split(order, POINTS) if len(g)]
    explained = naive.tau[:, dof] - final.tau[:, dof]
    model = final.track.model
    return {
        "joint": dof_name(model, dof),
        "unit": "N" if _slides(model, dof) else "N m",
        "against": "speed (m/s)" if _slides(model, dof) else "speed (rad/s)",
        "x": [float(naive.states.qvel[g, dof].mean()) for g in groups],
        "missing": [float(naive.tau[g, dof].mean()) for g in groups],
        "law": [float(explained[g].mean()) for g in groups],
    }


def dof_name(model, dof: int) -> str:
    """The joint of a degree of freedom, numbered where it has several."""
    joint = model.joint(int(model.dof_jntid[dof]))
    several = np.count_nonzero(model.dof_jntid == joint.id) > 1
    return f"{joint.name}[{dof - int(joint.dofadr[0])}]" if several else joint.name


def _slides(model, dof: int) -> bool:
    kind, first = int(model.jnt_type[model.dof_jntid[dof]]), int(model.jnt_dofadr[model.dof_jntid[dof]])
    return kind == 2 or (kind == 0 and dof - first < 3)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
