"""What laws that MuJoCo lacks do in one simulation step after the other."""

from collections.abc import Sequence

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.effects.gears import Coupling, coupled, encoders
from fimpact.effects.law_inputs import State

LAWS = ("force", "friction", "gear")  # asked once per step
WRITES = ("friction", "gear")  # change fields of the model from step to step, other ones in each window


class AddedForces:
    """Laws evaluated for all windows at once: as generalised forces and, in `copies`, as fields of each one's model."""

    def __init__(self, model: mujoco.MjModel, copies: Sequence[mujoco.MjModel], laws: Sequence[Placed]):
        self.model = model
        self.laws = [law for law in laws if law.effect.enters != "gear"]
        self.gears = [law for law in laws if law.effect.enters == "gear"]
        self._found: list[Coupling] = []
        # Asking a model takes longer than writing into what it gave.
        self._dofs = [int(model.joint(law.site).dofadr[0]) for law in self.gears]
        self._encoders = [encoders(model, law.site) for law in self.gears]
        rubbing = any(law.effect.enters == "friction" for law in laws)
        self._limits = [own.dof_frictionloss for own in copies] if rubbing else []
        self._own_limits = model.dof_frictionloss.copy()
        self._armatures = [own.dof_armature for own in copies]
        for own in copies:  # a law leaves them as they were in its last step
            own.dof_armature[:], own.dof_frictionloss[:] = model.dof_armature, model.dof_frictionloss

    def __call__(self, now: State, ahead: State) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the generalised forces beside the motors': mean over the step and at its start, (w, nv) each.

        Args:
            now: the states at the start of the step, which gears ask for. ahead: half a step later, for other laws.
        """
        force = np.zeros_like(now.qvel)
        limits = np.repeat(self._own_limits[None], len(force), 0) if self._limits else None
        for law in self.laws:
            _add(law, ahead, force, limits)
        instant = force.copy()
        self._found = [coupled(self.model, now, law.effect.law, law.site, law.values) for law in self.gears]
        for dof, found in zip(self._dofs, self._found, strict=True):
            force[:, dof] += found.pull
            instant[:, dof] += found.at_once[0]
        for own, row in zip(self._limits, () if limits is None else limits, strict=True):
            own[:] = row
        self._write_inertia([found.inertia for found in self._found])
        return force, instant

    def at_start(self) -> None:
        """Write the inertia that is felt at the very start of the step."""
        self._write_inertia([found.at_once[1] for found in self._found])

    def shift_encoders(self, sensed: np.ndarray) -> None:
        """Put encoders, in `sensed` (w, nsensordata), where their motors are."""
        for own, found in zip(self._encoders, self._found, strict=True):
            for columns, lead in zip(own, (found.lead, found.rate), strict=True):
                sensed[:, columns] += lead[:, None]

    def _write_inertia(self, inertias: Sequence[np.ndarray]) -> None:
        for dof, inertia in zip(self._dofs, inertias, strict=True):
            for own, felt in zip(self._armatures, inertia.tolist(), strict=True):
                own[dof] = felt


def _add(law: Placed, seen: State, force: np.ndarray, limits: np.ndarray | None) -> None:
    """Add what `law` does to the forces and, where it rubs, to the largest dry friction, (w, nv) each."""
    found = law.effect.law(seen, law.site, **law.values)
    if law.effect.enters == "force":
        force += found
        return
    dof, (forward, backward) = seen.model.joint(law.site).dofadr[0], found
    assert limits is not None  # there are some wherever a law rubs
    # Unequal limits are equal ones beside a constant force.
    limits[:, dof] += (forward + backward) / 2
    force[:, dof] += (backward - forward) / 2
