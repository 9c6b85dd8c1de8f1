"""Fit the effects that you name, and no others."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape

import pandas as pd

from fimpact import recordings
from fimpact.api.commands.fit_recording import Insisted, fit_effects, in_lines

COLUMNS = ["name", "of", "unit", "before", "naive", "after", "low", "high"]


@dataclass(frozen=True)
class Fit:
    """The model fitted with the effects that were named, beside the fit without them.

    Attributes:
        result: all that was fitted, for whoever needs more than is here; its fields may change.
    """

    result: Insisted

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """A row for each number: name, of (the unknown or ``effect@site``), unit, before (the model's own value), naive
        (its value in the fit without the effects), after, low and high (95 % interval)."""
        return pd.DataFrame(self.result.parameters, columns=COLUMNS)

    @cached_property
    def held_out(self) -> pd.DataFrame:
        """Errors of each held-out run in forward simulation, naive and improved; unit in `attrs`; empty if none is."""
        proof = self.result.proof
        table = pd.DataFrame(list(proof.runs) if proof else [])
        table.attrs |= {"unit": proof.unit, "noise_floor": proof.noise_floor} if proof else {}
        return table

    @property
    def summary(self) -> str:
        """What was fitted and what it is worth, a line for each number."""
        return "\n".join(in_lines(self.result))

    def __repr__(self) -> str:
        return f"Fit({self.summary!r})"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary)}</pre>"


def fit(
    recording: recordings.Recording, effects: Sequence[str], *, progress: Callable[[str], None] | None = None
) -> Fit:
    """Fit the model with the effects that you name.

    Args:
        recording: of `read_case` or `Recording.from_frames`.
        effects: ``effect@site`` each, such as ``coulomb@shoulder``; `catalogue` lists the effects.
        progress: receives one line at the start of each piece of work; None: silence.

    Raises:
        CaseError: an effect cannot be at that site, or the fit does not converge. ValueError: no such effect.
    """
    names = [effects] if isinstance(effects, str) else list(effects)
    return Fit(fit_effects(recording, names, progress or (lambda line: None)))
