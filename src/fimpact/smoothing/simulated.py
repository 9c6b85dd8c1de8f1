"""What laws do where all of them must be simulated: as along an earlier trajectory, and truly where it matters."""

from collections.abc import Callable, Sequence

from fimpact.effects.base import Placed
from fimpact.smoothing.response import Change
from fimpact.smoothing.smoother import Smoothed


class Simulated:
    """What was simulated for columns of one track, where a sample is long and so all edits of the model are.

    What was simulated along an earlier trajectory stands, enough to say what is worth more. `renew` asks for the true
    ones.
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

    def change(self, law: Placed, simulate: Callable[[Placed], Change]) -> Change:
        """What `law` does, as well as it is asked for."""
        key = _key(law)
        if key in self.wanted or (key not in self.true and key not in self.rough):
            self.true[key] = simulate(law)
        return self.true.get(key) or self.rough[key]


def _key(law: Placed) -> str:
    return f"{law.name} {law.values}"
