"""What laws do along a trajectory, or did along an earlier one, which is enough where it does not matter."""

from collections.abc import Callable, Sequence

from fimpact.effects.base import Placed
from fimpact.smoothing.dynamics.response import Change, responds_alike
from fimpact.smoothing.smoother import Smoothed


class Simulated:
    """What laws do, for columns of one track.

    What must be simulated stands from an earlier trajectory of a plant that responds alike: enough to say what is worth
    more. `renew` asks for what is true of this one.
    """

    def __init__(self) -> None:
        self.of: Smoothed | None = None
        self.earlier: dict[str, Change] = {}
        self.true: dict[str, Change] = {}
        self.wanted: set[str] = set()

    def along(self, smoothed: Smoothed) -> None:
        """Forget what is true of another trajectory, and what another plant did."""
        if smoothed is self.of:
            return
        if self.of and not responds_alike(self.of.linear.plant, smoothed.linear.plant):
            self.earlier = {}
        self.of, self.true, self.wanted = smoothed, {}, set()

    def holds(self, law: Placed) -> bool:
        """Whether it is known already what `law` truly does."""
        return _key(law) in self.true

    def keep(self, law: Placed, change: Change) -> None:
        """Take it that this is what `law` truly does."""
        self.true[_key(law)] = change

    def renew(self, laws: Sequence[Placed]) -> bool:
        """Whether any of these laws stands from an earlier trajectory; then it is wanted."""
        self.wanted = {_key(law) for law in laws} - set(self.true)
        return bool(self.wanted)

    def change(
        self,
        law: Placed,
        simulate: Callable[[Placed], tuple[Change, bool]],
    ) -> Change:
        """What `law` does, as well as it is asked for.

        Args:
            simulate: says too whether what it finds took a simulation; what did not is found anew each time.
        """
        key = _key(law)
        if key in self.earlier and key not in self.true and key not in self.wanted:
            return self.earlier[key]
        if key not in self.true:
            self.true[key], simulated = simulate(law)
            if simulated:
                self.earlier[key] = self.true[key]
        return self.true[key]


def _key(law: Placed) -> str:
    return f"{law.name} {law.values}"
