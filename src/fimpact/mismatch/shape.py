"""The shape of a force that has no name: against what it depends on, as a curve and, if one fits, an equation."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_smoothing_spline

from fimpact.mismatch.locate import Location

LEAST = 12  # points that a curve needs
FINEST = 1e-4  # of the range: points nearer to each other make a spline ill-posed
FAINT = 1e-9  # weight, relative to the largest, below which a point makes a spline ill-posed
TERMS = {
    "1": np.ones_like,
    "x": lambda x: x,
    "x|x|": lambda x: x * np.abs(x),
    "x^2": np.square,
    "x^3": lambda x: x**3,
    "sign(x)": np.sign,
    "sin(x)": np.sin,
    "cos(x)": np.cos,
}
ADDED = 0.05  # share of the variance that a further term must explain


@dataclass(frozen=True)
class Shape:
    """Residual force of one degree of freedom against one regressor: points (n,), curve on a grid, share of variance
    explained, and an equation or "" if no short one explains it."""

    dof: str
    regressor: str
    x: np.ndarray
    force: np.ndarray
    deviation: np.ndarray
    grid: np.ndarray
    curve: np.ndarray
    explained: float
    equation: str


def shapes(location: Location) -> list[Shape]:
    """Curves of every residual force against its own position, speed and time, the most telling first."""
    found = []
    for dof, name in enumerate(location.dofs):
        own = {"speed": location.qvel[..., dof], "time": location.time}
        if location.qpos.shape[2] == location.qvel.shape[2]:
            own["position"] = location.qpos[..., dof]
        for regressor, x in own.items():
            found.append(_shape(name, regressor, x.ravel(), location.force[..., dof], location.deviation[..., dof]))
    return sorted((s for s in found if s), key=lambda s: -s.explained)


def _shape(dof: str, regressor: str, x, force, deviation) -> Shape | None:
    x, y, sd = _merged(x, force.ravel(), deviation.ravel())
    if len(x) < LEAST:
        return None
    weight = np.maximum((sd.min() / sd) ** 2, FAINT)
    span = x[-1] - x[0]
    spline = make_smoothing_spline((x - x[0]) / span, y, weight)
    grid = np.linspace(x[0], x[-1], 100)
    fitted = spline((x - x[0]) / span)
    total = (weight * (y - np.average(y, weights=weight)) ** 2).sum() or 1.0
    explained = float(1 - (weight * (y - fitted) ** 2).sum() / total)
    return Shape(dof, regressor, x, y, sd, grid, spline((grid - x[0]) / span), explained, _equation(x, y, weight))


def _merged(x, y, sd) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points in the order of x, those that a spline could not hold apart as one: their weighted means."""
    apart = FINEST * np.ptp(x)
    groups = np.unique(np.round((x - x.min()) / (apart or 1.0)), return_inverse=True)[1]
    weight = np.maximum(sd, FAINT * sd.max()) ** -2.0
    total = np.bincount(groups, weight)
    return *(np.bincount(groups, weight * part) / total for part in (x, y)), total**-0.5


def _equation(x, y, weight) -> str:
    """Few terms of the library, chosen one by one, as long as each explains more."""
    root, chosen, best = np.sqrt(weight), [], 0.0
    total = (weight * y**2).sum() or 1.0
    while len(chosen) < 3:
        tried = {term: _share([*chosen, term], x, y, root, total) for term in TERMS if term not in chosen}
        term = max(tried, key=lambda t: tried[t][0])
        if tried[term][0] < best + ADDED:
            break
        best, weights = tried[term]
        chosen.append(term)
    if best < 0.5:
        return ""
    return " ".join(f"{w:+.3g} {term}" for w, term in zip(weights, chosen, strict=True))


def _share(terms: list[str], x, y, root, total) -> tuple[float, np.ndarray]:
    columns = np.stack([TERMS[t](x) for t in terms], 1) * root[:, None]
    weights, *_ = np.linalg.lstsq(columns, y * root, rcond=None)
    return 1 - float(((columns @ weights - y * root) ** 2).sum()) / total, weights
