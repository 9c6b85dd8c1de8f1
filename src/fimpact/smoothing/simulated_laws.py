"""What laws do along a trajectory, simulated roughly at first, and truly where it matters."""

from collections.abc import Callable, Sequence

from fimpact.effects.base import Placed
from fimpact.smoothing.dynamics.response import Change, responds_alike
from fimpact.smoothing.smoother import Smoothed


class Simulated:
    """What laws do, for columns of one track.

    What must be simulated is simulated roughly at first, or stands from an earlier trajectory of a plant that responds
    alike: enough to say what is worth more. `renew` asks for the true ones. truly: all are, at once.
    """

    def __init__(self, truly: bool = False):
        self.truly = truly
        self.of: Smoothed | None = None
        self.rough: dict[str, Change] = {}
        self.true: dict[str, Change] = {}
        self.wanted: set[str] = set()

    def along(self, smoothed: Smoothed) -> None:
        """Forget what is true of another trajectory, and what another plant did."""
        if smoothed is self.of:
            return
        if self.of and not responds_alike(self.of.linear.plant.model, smoothed.linear.plant.model):
            self.rough = {}
        self.of, self.true, self.wanted = smoothed, {}, set()

    def holds(self, law: Placed) -> bool:
        """Whether it is known already what `law` truly does."""
        return _key(law) in self.true

    def keep(self, law: Placed, change: Change) -> None:
        """Take it that this is what `law` truly does."""
        self.true[_key(law)] = change

    def renew(self, laws: Sequence[Placed]) -> bool:
        """Whether any of these laws is but rough yet; then it is wanted."""
        self.wanted = {_key(law) for law in laws} - set(self.true)
        return bool(self.wanted)

    def change(
        self,
        law: Placed,
        simulate: Callable[[Placed], Change],
        roughly: Callable[[Placed], tuple[Change, bool]],
    ) -> Change:
        """What `law` does, as well as it is asked for.

        Args:
            roughly: says too whether what it finds took a simulation; what did not is true.
        """
        key = _key(law)
        if key in self.true:
            return self.true[key]
        if self.truly or key in self.wanted:
            self.true[key] = self.rough[key] = simulate(law)
        elif key not in self.rough:
            change, simulated = roughly(law)
            (self.rough if simulated else self.true)[key] = change
        return self.true[key] if key in self.true else self.rough[key]


def _key(law: Placed) -> str:
    return f"{law.name} {law.values}"
