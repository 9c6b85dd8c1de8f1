"""What laws do where all of them must be simulated: roughly at first, and truly where it matters."""

from collections.abc import Callable, Sequence

from fimpact.effects.base import Placed
from fimpact.smoothing.dynamics.response import Change
from fimpact.smoothing.smoother import Smoothed


class Simulated:
    """What was simulated for columns of one track, where a sample is long and so all edits of the model are.

    At first each is simulated roughly, or stands from an earlier trajectory: enough to say what is worth more. `renew`
    asks for the true ones.
    """

    def __init__(self):
        self.of: Smoothed | None = None
        self.rough: dict[str, Change] = {}
        self.true: dict[str, Change] = {}
        self.wanted: set[str] = set()

    def along(self, smoothed: Smoothed) -> None:
        """Forget what is true of another trajectory."""
        if smoothed is not self.of:
            self.rough |= self.true
            self.of, self.true, self.wanted = smoothed, {}, set()

    def renew(self, laws: Sequence[Placed]) -> bool:
        """Whether any of these laws is but rough yet; then it is wanted."""
        self.wanted = ({_key(law) for law in laws} & set(self.rough)) - set(self.true)
        return bool(self.wanted)

    def change(self, law: Placed, simulate: Callable[[Placed], Change], roughly: Callable[[Placed], Change]) -> Change:
        """What `law` does, as well as it is asked for."""
        key = _key(law)
        if key in self.wanted:
            self.true[key] = simulate(law)
        elif key not in self.true and key not in self.rough:
            self.rough[key] = roughly(law)
        return self.true.get(key) or self.rough[key]


def _key(law: Placed) -> str:
    return f"{law.name} {law.values}"
