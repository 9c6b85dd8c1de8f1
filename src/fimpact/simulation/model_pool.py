"""A model for each window, for laws that write into its fields while it moves."""

import copy

import mujoco
import numpy as np

STRUCTS = ("opt", "stat")


class ModelPool:
    """Copies of one model after the other.

    Making a copy takes longer than simulating a window does, so they are made once and then only told what changed.
    """

    def __init__(self):
        self._made: list[mujoco.MjModel] = []
        self._like: mujoco.MjModel | None = None
        self._arrays: list[str] = []

    def for_windows(self, model: mujoco.MjModel, count: int) -> list[mujoco.MjModel]:
        """Copy `model`, whose sizes are always the same, `count` times.

        What a law wrote into the copies is for the next law to put back (`AddedForces`).
        """
        if self._like is None:
            self._arrays = [name for name in dir(model) if _holds_numbers(getattr(model, name))]
        elif self._like is not model:
            self._follow(model)
        self._like = model
        self._made += [copy.copy(model) for _ in range(count - len(self._made))]
        return self._made[:count]

    def _follow(self, model: mujoco.MjModel) -> None:
        for name in self._arrays:
            value = getattr(model, name)
            if not np.array_equal(value, getattr(self._like, name)):
                for own in self._made:
                    getattr(own, name)[:] = value
        for struct in STRUCTS:
            now, before = getattr(model, struct), getattr(self._like, struct)
            for name in (name for name in dir(now) if not name.startswith("_")):
                if not np.array_equal(getattr(now, name), getattr(before, name)):
                    for own in self._made:
                        setattr(getattr(own, struct), name, getattr(now, name))


def _holds_numbers(value: object) -> bool:
    return isinstance(value, np.ndarray) and value.size > 0 and value.dtype.kind in "biuf"
