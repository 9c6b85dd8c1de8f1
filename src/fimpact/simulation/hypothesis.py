"""A hypothesis: values of the unknowns, and effects added to the model."""

from dataclasses import dataclass

import numpy as np

from fimpact.effects.base import Placed


@dataclass(frozen=True)
class Hypothesis:
    """Values of the recording's unknowns, (p,), and the effects that are added."""

    theta: np.ndarray
    placed: tuple[Placed, ...] = ()

    def of_kind(self, *enters: str) -> list[Placed]:
        """Effects that enter in one of these ways."""
        return [placed for placed in self.placed if placed.effect.enters in enters]
