"""What a law is given: the state of simulations in one step, or whole signals."""

from dataclasses import dataclass, field

import mujoco
import numpy as np

KINEMATICS, MOTORS, HELD = "kinematics", "motors", "held"  # keys of a memory that no law has kept


@dataclass
class State:
    """The state of n simulations in one step, as a force law sees it.

    qpos (n, nq), qvel (n, nv), ctrl (n, nu), time (n,) since the start of the run, step: s.
    memory: anything a law with a state of its own keeps, by its own key; at the start of a window no law has kept any.
    bodies: what `body` has found, where several laws ask the same states; None: it is not kept.
    qacc: accelerations, (n, nv), where they are known.
    """

    model: mujoco.MjModel
    qpos: np.ndarray
    qvel: np.ndarray
    ctrl: np.ndarray
    time: np.ndarray
    step: float
    memory: dict = field(default_factory=dict)
    bodies: dict | None = None
    qacc: np.ndarray | None = None

    @property
    def remembers(self) -> bool:
        """Whether a law has kept anything here."""
        return bool(self.memory.keys() - {KINEMATICS, MOTORS, HELD})

    def joint(self, site: str) -> tuple[int, np.ndarray, np.ndarray]:
        """Degree of freedom, position (n,) and speed (n,) of the hinge or slide joint `site`."""
        joint = self.model.joint(site)
        return joint.dofadr[0], self.qpos[:, joint.qposadr[0]], self.qvel[:, joint.dofadr[0]]

    def acceleration(self, dof: int, key: tuple) -> np.ndarray:
        """Acceleration, (n,), of a degree of freedom: known, or since the step before, remembered under `key`."""
        if self.qacc is not None:
            return self.qacc[:, dof]
        speed = self.qvel[:, dof].copy()
        last, self.memory[key] = self.memory.get(key, speed), speed
        return (speed - last) / self.step

    def body(self, site: str | int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position (n, 3), velocity (n, 3) of the centre of mass of body `site`, a name or number, and its Jacobian
        (n, 3, nv)."""
        if self.bodies is None:
            return self._body(site)
        if site not in self.bodies:
            self.bodies[site] = self._body(site)
        return self.bodies[site]

    @property
    def kinematics(self) -> mujoco.MjData:
        """Data to compute with; making it takes longer than what is done with it."""
        if KINEMATICS not in self.memory:
            self.memory[KINEMATICS] = mujoco.MjData(self.model)
        return self.memory[KINEMATICS]

    def _body(self, site: str | int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        model, data, body = self.model, self.kinematics, self.model.body(site).id
        position, jacobian = np.empty((len(self.qpos), 3)), np.zeros((len(self.qpos), 3, model.nv))
        place, centre = data.qpos, data.xipos[body]  # asking for them takes as long as what is done with them
        for own, moved, qpos in zip(position, jacobian, self.qpos, strict=True):
            place[:] = qpos
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacBodyCom(model, data, moved, None, body)
            own[:] = centre
        return position, np.einsum("nij,nj->ni", jacobian, self.qvel), jacobian

    def on_joint(self, dof: int, force: np.ndarray) -> np.ndarray:
        """The generalised force, (n, nv), of `force` (n,) on one degree of freedom."""
        out = np.zeros_like(self.qvel)
        out[:, dof] = force
        return out


@dataclass(frozen=True)
class Signal:
    """Time base and commands that belong to an array of measurements or commands.

    time: (n, T), s since the start of the run. ctrl: (n, T, nu), as recorded. channels: names of the measured
    columns, (ny,). actuators: names of the command columns, (nu,). force: (n, T, nu), generalised force or
    force of each actuator. joint_of: the channel measures the position of this joint, or "" if it does not.
    driven_by: the actuator that drives that joint, or -1. holding: whether each actuator holds a position; before the
    start of a run it is told the first one, any other nothing. since: (n, 1), s, where what is asked for begins if
    `time` reaches back further. noise: (n, T, nu), what of `ctrl` is noise of a log that no motor has felt, or None.
    parts: of `time` that belong to one sample: what is read of forces may jump from the last of them to the next.
    """

    time: np.ndarray
    ctrl: np.ndarray
    channels: tuple[str, ...]
    actuators: tuple[str, ...]
    force: np.ndarray
    joint_of: tuple[str, ...]
    driven_by: tuple[int, ...]
    holding: tuple[bool, ...] = ()
    since: np.ndarray | None = None
    noise: np.ndarray | None = None
    parts: int = 1

    @property
    def begin(self) -> np.ndarray:
        """Time at which what is asked for begins, (n, 1), s."""
        return self.time[:, :1] if self.since is None else self.since

    def before(self, ctrl: np.ndarray) -> np.ndarray:
        """What is commanded before the start of `ctrl`, (n, T, nu): (n, 1, nu)."""
        return np.where(self.holding or (False,) * ctrl.shape[2], ctrl[:, :1], 0.0)

    def column(self, site: str) -> list[int]:
        """Columns that `site` names: one channel or actuator, or every one of them for "all"."""
        names = self.channels if site in self.channels else self.actuators
        return list(range(len(names))) if site == "all" else [names.index(site)]
