"""What a search may ask: everything, classes only, one family only, or as much as a time allows."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import inf
from time import monotonic

from fimpact.effects.base import Effect
from fimpact.selection.options import Option


@dataclass(frozen=True)
class Limits:
    """Bounds of a search. quick: classes of places only, and no refinements. family: the only one that is asked for, ""
    for all. seconds: after which nothing more is asked, from `begun` on; what is asked is always answered."""

    quick: bool = False
    family: str = ""
    seconds: float = inf
    begun: float = 0.0

    @property
    def over(self) -> bool:
        """Whether nothing more may be asked."""
        return monotonic() - self.begun >= self.seconds

    def effects(self, catalogue: Iterable[Effect]) -> list[Effect]:
        """Those of the catalogue that are asked for."""
        return [effect for effect in catalogue if self.family in ("", effect.family)]

    def options(self, offered: Sequence[Option]) -> list[Option]:
        """Those that are asked for: where only classes are, single places only of what can be at no other."""
        places = Counter(name.partition("@")[0] for name in {option.name for option in offered if "@" in option.name})
        alone = {option.name for option in offered if places[option.name.partition("@")[0]] == 1}
        return [option for option in offered if not self.quick or "@" not in option.name or option.name in alone]

    def unasked(self, stopped: bool) -> tuple[str, ...]:
        """Sentences about what was not asked.

        Args:
            stopped: whether the time was over before all was asked.
        """
        said = [f"Only {self.family} was asked for (--only)."] if self.family else []
        said += ["Not asked for: single ones of several places, and small refinements (--quick)."] if self.quick else []
        said += [f"After {self.seconds:g} s nothing more was asked for (--budget): more may be missing."] * stopped
        return tuple(said)
