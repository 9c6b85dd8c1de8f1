"""What laws that MuJoCo lacks do in one step after the other."""

import mujoco
import numpy as np

from fimpact.effects.base import Placed, State
from fimpact.effects.gears import coupled, encoders

OWN = ("friction", "gear")  # what changes fields of the model from step to step, other ones in each window


class Acting:
    """What laws do in one step after the other, in the fields of the models of all windows, `copies`, and as forces."""

    def __init__(self, model: mujoco.MjModel, copies: list[mujoco.MjModel], laws: list[Placed]):
        self.model = model
        self.laws = [law for law in laws if law.effect.enters != "gear"]
        self.gears = [law for law in laws if law.effect.enters == "gear"]
        self._found: list = []
        # Asking a model takes longer than writing into what it gave.
        self._dofs = [model.joint(law.site).dofadr[0] for law in self.gears]
        self._encoders = [encoders(model, law.site) for law in self.gears]
        rubbing = any(law.effect.enters == "friction" for law in laws)
        self._losses = [own.dof_frictionloss for own in copies] if rubbing else []
        self._dry = model.dof_frictionloss.copy()
        self._armatures = [own.dof_armature for own in copies]
        for own in copies:  # a law leaves them as they were in its last step
            own.dof_armature[:], own.dof_frictionloss[:] = model.dof_armature, model.dof_frictionloss

    def __call__(self, now: State, seen: State, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Generalised forces beside the motors', mean over the step and at its start, (w, nv) each.

        Args:
            now, seen: the states at the start of the step, for gears, and half a step ahead, for all other laws.
            force: what acts anyway.
        """
        pull, limits = force.copy(), np.repeat(self._dry[None], len(force), 0) if self._losses else None
        for law in self.laws:
            _act(law, seen, pull, limits)
        at_once = pull.copy()
        self._found = [coupled(self.model, now, law.effect.law, law.site, law.values) for law in self.gears]
        for dof, found in zip(self._dofs, self._found, strict=True):
            pull[:, dof] += found.pull
            at_once[:, dof] += found.at_once[0]
        if self._losses:
            for own, row in zip(self._losses, limits, strict=True):
                own[:] = row
        self._felt([found.inertia for found in self._found])
        return pull, at_once

    def begin(self) -> None:
        """Inertia as it is felt at the very start of the step."""
        self._felt([found.at_once[1] for found in self._found])

    def read(self, sensed: np.ndarray) -> None:
        """Put encoders, (w, nsensordata), where their motors are."""
        for own, found in zip(self._encoders, self._found, strict=True):
            for columns, ahead in zip(own, (found.lead, found.rate), strict=True):
                sensed[:, columns] += ahead[:, None]

    def _felt(self, inertias: list[np.ndarray]) -> None:
        for dof, inertia in zip(self._dofs, inertias, strict=True):
            for own, felt in zip(self._armatures, inertia.tolist(), strict=True):
                own[dof] = felt


def _act(law: Placed, seen: State, pull: np.ndarray, limits: np.ndarray | None) -> None:
    """Add what `law` does to the forces and, where it rubs, to the largest dry friction, (w, nv) each."""
    acts = law.effect.law(seen, law.site, **law.values)
    if law.effect.enters == "force":
        pull += acts
        return
    dof, (forward, backward) = seen.model.joint(law.site).dofadr[0], acts
    # Unequal limits are equal ones beside a constant force.
    limits[:, dof] += (forward + backward) / 2
    pull[:, dof] += (backward - forward) / 2
