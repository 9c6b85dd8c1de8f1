"""A synthetic `cases.csv`: what a good but imperfect tool might answer."""

import numpy as np
import pandas as pd

from fimpact.benchmark.grading.score import COLUMNS

EFFECTS = ("coulomb", "stribeck", "payload", "spring", "gain", "command_delay", "sensor_delay", "ground_height")
SITES = {
    "payload": "link",
    "gain": "motor",
    "command_delay": "motor",
    "sensor_delay": "encoder",
    "ground_height": "wall",
}
SYSTEMS = ("arm_free", "arm_contact", "block")


def cases(counts: dict[str, int], seed: int = 0) -> pd.DataFrame:
    """So many cases of each kind, a third of them with comparators."""
    rng = np.random.default_rng(seed)
    rows = [_case(rng, kind) for kind, count in counts.items() for _ in range(count)]
    table = pd.DataFrame(rows)
    table.insert(0, "case", [f"{i:03d}" for i in range(1, len(table) + 1)])
    rest = [name for name in table if name not in COLUMNS]
    return table[[*COLUMNS, *rest]]


def _names(rng, kind: str) -> list[str]:
    count = {"null": 0, "double": 2}.get(kind, 1)
    chosen = rng.choice(EFFECTS, count, replace=False)
    return sorted(f"{name}@{SITES.get(name, 'joint')}_{rng.integers(1, 4)}" for name in chosen)


def _case(rng, kind: str) -> dict:
    names = ["magnet@link_3"] if kind == "outside" else _names(rng, kind)
    size = float(np.exp(rng.uniform(np.log(3), np.log(3000)))) if names else 0.0
    detected = bool(rng.random() < size / (size + 6)) if names else bool(rng.random() < 0.04)
    answer, members, confidence = _answer(rng, kind, names, detected)
    before = float(np.sqrt(1 + size / 100))
    row = {
        "kind": kind,
        "system": str(rng.choice(SYSTEMS)),
        "planted": "+".join(n.split("@")[0] for n in names) or "none",
        "site": "+".join(n.split("@")[1] for n in names) or "none",
        "size": "+".join(["0.1"] * len(names)) or "",
        "kappa": float(1 - 10 ** rng.uniform(-3, 0)) if names else 0.0,
        "detected": detected,
        "answer": answer,
        "answer_set": "|".join(members),
        "located": bool(rng.random() < 0.97) if names else None,
        "heldout_before": before,
        "heldout_after": before if not detected else 1.0 + 0.02 * rng.random(),
        "heldout_oracle": None if kind == "outside" else 1.0,
        "noise_floor": 0.99,
        "seconds": float(rng.uniform(8, 30)),
        "status": "done",
        "truth": "+".join(names) or "none",
        "rival": "dahl@joint_1" if kind == "twin" else None,
        "lambda": size,
        "confidence": confidence,
        "right": answer == ("+".join(names) or "none"),
        "partly": any(n in answer for n in names),
        "in_set": ("+".join(names) or "none") in members,
        "place_right": bool(rng.random() < 0.9) if names else None,
        "mode_right": bool(rng.random() < 0.9) if names and kind == "single" else None,
        "intervals": 1 if names and answer == "+".join(names) else None,
        "covered": int(rng.random() < 0.95) if names and answer == "+".join(names) else None,
        "exported": float(10 ** rng.uniform(-5, -2)) if detected else None,
        "both_in_set": len(members) > 1 if kind == "twin" else None,
        "resolved_designed": bool(rng.random() < 0.9) if kind == "twin" and len(members) > 1 else None,
        "resolved_random": bool(rng.random() < 0.5) if kind == "twin" and len(members) > 1 else None,
        "job_diagnosis": float(rng.uniform(10, 40)),
    }
    return row | _peers(rng, row)


def _answer(rng, kind: str, names: list[str], detected: bool) -> tuple[str, list[str], float | None]:
    if not detected:
        return "none", ["none"], 0.96
    if kind == "outside":
        said = rng.random() < 0.9
        return ("unnamed", ["unnamed", "spring@joint_1"], None) if said else ("spring@joint_1", ["spring@joint_1"], 0.9)
    own, wrong = "+".join(names) or "spring@joint_1", f"stribeck@joint_{rng.integers(1, 4)}"
    best = own if rng.random() < 0.92 else wrong
    other = "dahl@joint_1" if kind == "twin" else wrong if rng.random() < 0.3 else best
    confidence = float(rng.uniform(0.5, 0.99) if other != best else rng.uniform(0.9, 1.0))
    return best, list(dict.fromkeys([best, other])), confidence


def _peers(rng, row: dict) -> dict:
    names = "heldout_blackbox heldout_sysid heldout_sysid_five heldout_refit_all screening_seconds refit_all_seconds"
    if rng.random() > 1 / 3:
        return dict.fromkeys([*names.split(), "answer_refit_all"])
    before = row["heldout_before"]
    worse = (1 + (before - 1) * rng.uniform(0.2, 0.6), before * 1.1, before * 1.02, 1.05, 0.4, 60.0)
    return dict(zip(names.split(), map(float, worse), strict=True)) | {"answer_refit_all": row["truth"]}
