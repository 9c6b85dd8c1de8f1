"""Laws that remember, passed along all runs side by side: which may, and on what."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from fimpact.effects.base import Placed
from fimpact.effects.drives import Ahead
from fimpact.effects.gears import Shaft
from fimpact.smoothing.dynamics.track import Track

ABREAST = 2048  # rows that pass side by side at most: beyond, steps take as long as there are rows


def groups_of(track: Track, laws: Sequence[Placed], kinds: Mapping[int, object]) -> list[list[int]]:
    """Laws that may pass side by side: of one effect and one of `kinds`, by index, and neutral in the same values."""
    groups: dict[object, list[int]] = {}
    for i, kind in kinds.items():
        effect, values = laws[i].effect, laws[i].values
        beside = tuple(np.sign(value - effect.neutral.get(name, 0.0)) for name, value in values.items())
        key = (effect.name, effect.law, tuple(values), beside, kind) if effect.side_by_side else i
        groups.setdefault(key, []).append(i)
    most = max(1, ABREAST // len(track.pieces[0]))
    return [group[a : a + most] for group in groups.values() for a in range(0, len(group), most)]


def values_of(track: Track, laws: Sequence[Placed]) -> Mapping[str, np.ndarray | float]:
    """Values of laws of one effect, as of one or for each row of their pieces, (n,)."""
    if len(laws) == 1:
        return laws[0].values
    count = len(track.pieces[0])
    return {name: np.repeat([law.values[name] for law in laws], count) for name in laws[0].values}


def longest_piece(track: Track) -> int:
    """Steps of the pieces up to the last that counts."""
    return int(np.flatnonzero(track.pieces[1].any(0))[-1]) + 1


def shafts_abreast(shafts: Sequence[Shaft], rows: np.ndarray) -> Iterator[Shaft]:
    """One shaft after the other of all `shafts` side by side, on each of the `rows` (pieces, n)."""
    (first, *more), count = shafts, len(rows)
    memory: dict[object, object] = {}
    torque, speed = (np.concatenate([getattr(own, name)[rows.T] for own in shafts], 1) for name in ("torque", "speed"))
    rotor = np.repeat([own.rotor for own in shafts], count) if more else first.rotor
    own_servos = [own.servo for own in shafts if isinstance(own.servo, Ahead)]
    servos = _servos(own_servos, rows) if own_servos else None
    for k in range(rows.shape[1]):
        yield Shaft(torque[k], speed[k], rotor, first.step, memory, next(servos) if servos else None)


def _servos(servos: Sequence[Ahead], rows: np.ndarray) -> Iterator[Ahead]:
    """One motor after the other of all `servos` side by side, on each of the `rows` (pieces, n)."""
    widest = max(len(own.force) for own in servos)

    def padded(name: str, fill: float) -> list[np.ndarray]:
        # Where another joint has more actuators, ours has some that give nothing.
        parts = [getattr(own, name) for own in servos]
        missing = [[(0, 0)] * (part.ndim - 2) + [(0, widest - part.shape[-2]), (0, 0)] for part in parts]
        return [np.pad(part, add, constant_values=fill) for part, add in zip(parts, missing, strict=True)]

    force, slopes = (np.concatenate([p[..., rows.T] for p in padded(name, 0.0)], -1) for name in ("force", "slopes"))
    held = np.concatenate([own.held[rows.T] for own in servos], 1)
    fills = {"gear": 0.0, "low": -np.inf, "high": np.inf}
    gear, low, high = (np.concatenate([np.repeat(p, len(rows), 1) for p in padded(*fill)], 1) for fill in fills.items())
    least, most = (np.repeat([getattr(own, name) for own in servos], len(rows)) for name in ("least", "most"))
    for k in range(rows.shape[1]):
        yield Ahead(force[:, k], slopes[:, :, k], gear, low, high, held[k], least, most)
