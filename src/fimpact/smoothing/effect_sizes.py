"""How large an effect may be is known, how small is not: each order of magnitude below is as likely as the last.

A prior that is normal at every scale takes it for a surprise when a spring is a hundredth as stiff as springs may be,
and charges that to whatever has more numbers. References: Jaynes, Probability Theory, Cambridge University Press, 2003,
ch. 12; Gelman, Bayesian Analysis 1(3), 2006.
"""

from collections.abc import Hashable, Sequence

import numpy as np
from scipy.special import logsumexp

from fimpact.deciding import NOTHING
from fimpact.smoothing.parameters import Parameter

COUNT = 25
SCALES = NOTHING ** ((np.arange(COUNT) + 0.5) / COUNT)  # of the largest size


def of_any_scale(effects: Sequence[Hashable], sizes: np.ndarray, doubts: np.ndarray) -> float:
    """By how much likelier amplitudes are, in logarithms, where the scale of each effect is unknown, than where it is
    that of the priors.

    Args:
        effects: of each amplitude, all of which have the scale of their effect. sizes: of the amplitudes, and doubts:
            their sd, in sd of their priors, (k,) each.
    """
    whole = 0.0
    for effect in dict.fromkeys(effects):
        own = [i for i, other in enumerate(effects) if other == effect]
        spread = np.append(SCALES, 1.0)[:, None] ** 2 + doubts[own] ** 2
        likely = -0.5 * (sizes[own] ** 2 / spread + np.log(spread)).sum(1)
        whole += float(logsumexp(likely[:-1]) - np.log(COUNT) - likely[-1])
    return whole


def is_amplitude(number: Parameter) -> bool:
    """Whether a number is how much of an effect there is: of nothing there is none."""
    return number.place >= 0 and not number.mean and bool(np.isfinite(number.sd))


def scales_unknown(numbers: Sequence[Parameter], information: np.ndarray) -> float:
    """`of_any_scale` of the amplitudes among the numbers of a fit; information: (p, p), of their coordinates."""
    own = [i for i, n in enumerate(numbers) if is_amplitude(n)]
    if not own or not np.isfinite(information).all():
        return 0.0
    doubts = np.sqrt(np.maximum(np.diag(inverse(information))[own], 0.0))
    sd, slopes = (np.array([getattr(numbers[i], name) for i in own]) for name in ("sd", "slope"))
    sizes = np.array([numbers[i].value for i in own]) / sd
    return of_any_scale([numbers[i].place for i in own], sizes, doubts * np.abs(slopes) / sd)


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric matrix whose columns may differ in size by orders of magnitude."""
    scale = np.sqrt(np.where(np.diag(matrix) > 0, np.diag(matrix), 1.0))
    return np.linalg.pinv(matrix / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
