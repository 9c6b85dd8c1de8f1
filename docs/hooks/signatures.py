"""A picture of what each effect does to a log: one reading, and the force that the model then lacks."""

from functools import cache, partial
from io import BytesIO

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from matplotlib.axes import Axes

from fimpact.effects.base import Effect, Placed
from fimpact.recordings import Recording, Run
from fimpact.report.look import IMPROVED, LOOK, QUIET
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.windows import cut
from fimpact.smoothing.candidates import at, scales_along
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States
from fimpact.support.channel_units import channel_unit

ARM = """<mujoco><option timestep="0.002"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.05"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.6"/>
<body name="lower" pos="0 0 -0.3"><joint name="elbow" axis="0 1 0" damping="0.02" stiffness="0.1"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.4"/><site name="imu" pos="0 0 -0.2"/></body></body>
</worldbody><actuator><motor name="motor_1" joint="shoulder"/><motor name="motor_2" joint="elbow"/></actuator>
<sensor><jointpos name="shoulder" joint="shoulder"/><jointpos name="elbow" joint="elbow"/>
<accelerometer name="imu" site="imu"/></sensor></mujoco>"""
SERVO = ARM.replace('<motor name="motor_1"', '<position name="motor_1" kp="20" kv="1"').replace(
    '<motor name="motor_2"', '<position name="motor_2" kp="10" kv="0.5"'
)
BALL = """<mujoco><option timestep="0.002"/><worldbody>
<geom name="table" type="plane" size="1 1 .05" friction="0.4" solref="-4000 -40"/>
<body name="ball" pos="0 0 0.3"><freejoint name="free"/>
<geom name="shell" type="sphere" size="0.05" mass="0.3" friction="0.6" solref="-5000 -20"/></body></worldbody>
<sensor><framepos name="place" objtype="body" objname="ball"/></sensor></mujoco>"""
CHANNELS = {
    "arm": ("shoulder", "elbow", "imu[0]", "imu[2]"),
    "servo": ("shoulder", "elbow"),
    "ball": ("place[0]", "place[1]", "place[2]"),
}
STARTS = {
    "arm": (np.array([0.6, 0.4]), np.zeros(2)),
    "servo": (np.zeros(2), np.zeros(2)),
    "ball": (np.array([0, 0, 0.3, 1, 0, 0, 0.0]), np.array([1.0, 0.2, -1.0, 0, 20, 5])),
}
XML = {"arm": ARM, "servo": SERVO, "ball": BALL}
PERIOD, SAMPLES = 0.002, 750
FINER = 4  # parts of a sample that are simulated: the error of the time step must not pass for a force
SIZE = 0.3  # of what is plausible
CLEAR = 3.0  # times the force that differences of readings leave where nothing is missing


class Rig:
    """A model in motion, what it reads, and the sizes of its motion."""

    def __init__(self, name: str):
        self.qpos, self.qvel = STARTS[name]
        self.channels = CHANNELS[name]
        model = mujoco.MjModel.from_xml_string(XML[name])
        time = np.arange(SAMPLES)[:, None] * PERIOD
        ctrl = [1.2, 0.5] * np.sin([4.0, 5.5] * time + [0.0, 1.0]) if model.nu else np.zeros((SAMPLES, 0))
        empty = np.zeros((SAMPLES, len(self.channels)))
        self.recording = self._recorded(XML[name], ctrl, empty)
        self.simulator = Simulator(self.recording, FINER)
        self.read = self.predicted(())
        self.recording = self._recorded(XML[name], ctrl, self.read)
        self.scales = self._scales()
        self.left = np.sqrt((self.lacking(self.read)[1] ** 2).mean(0)).max() if model.nu else np.inf

    def _recorded(self, xml: str, ctrl: np.ndarray, measured: np.ndarray) -> Recording:
        run = Run("run", ctrl, measured, False, self.qpos, self.qvel)
        noise, sd = np.full(len(self.channels), 1e-4), np.full(2 * len(self.qvel), np.inf)
        return Recording(xml, ".", PERIOD, self.channels, (run,), (), noise, sd, 0.0)

    def predicted(self, placed: tuple[Placed, ...]) -> np.ndarray:
        """What is read, (T, ny), of a model with these effects."""
        windows = cut(self.recording.runs, 0)
        return self.simulator.predict(Hypothesis(np.zeros(0), placed), windows, self.qpos[None], self.qvel[None])[0]

    def _scales(self):
        model = self.simulator.base
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = self.qpos, self.qvel
        rows = []
        for ctrl in self.recording.runs[0].ctrl:
            data.ctrl[:] = ctrl
            rows.append((data.qpos.copy(), data.qvel.copy(), data.act.copy()))
            mujoco.mj_step(model, data)
        states = States(*(np.array(part) for part in zip(*rows, strict=True)))
        track = Track(Simulator(self.recording), self.recording.runs)
        return scales_along(track, track.model, states, np.zeros_like(states.qvel))

    def lacking(self, read: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Speed and missing force, (T, nv) each, of the arm by inverse dynamics of what its encoders read."""
        model = mujoco.MjModel.from_xml_string(self.recording.xml)
        data, q = mujoco.MjData(model), read[:, : model.nv]
        v = np.gradient(q, PERIOD, axis=0)
        a = np.gradient(v, PERIOD, axis=0)
        force = np.zeros_like(q)
        for k, ctrl in enumerate(self.recording.runs[0].ctrl):
            data.qpos[:], data.qvel[:], data.qacc[:], data.ctrl[:] = q[k], v[k], a[k], ctrl
            mujoco.mj_inverse(model, data)
            needed = data.qfrc_inverse.copy()
            mujoco.mj_forward(model, data)
            force[k] = needed - data.qfrc_actuator
        return v[5:-5], force[5:-5]


@cache
def _rig(name: str) -> Rig:
    return Rig(name)


def signature(effect: Effect) -> bytes:
    """The picture as PNG; empty where none of the rigs has a place for the effect.

    The size is a third of what the catalogue holds plausible; of several numbers, the later ones are smaller still.
    """
    for name in ("arm", "servo", "ball"):
        rig = _rig(name)
        for site in effect.sites(rig.simulator.base, rig.channels):
            offered = at(effect, site, rig.simulator.base, rig.scales)
            if not offered:
                continue
            own = offered[len(offered) // 2]
            placed = own.placed([SIZE * sd / (1 + i) for i, sd in enumerate(own.sd)])
            read = rig.predicted((placed,))
            if np.isfinite(read).all() and np.abs(read - rig.read).max() > 1e-9:
                return _drawn(rig, placed, read)
    return b""


def _drawn(rig: Rig, placed: Placed, read: np.ndarray) -> bytes:
    panels = [partial(_change, rig=rig, read=read)]
    if np.isfinite(rig.left):
        speed, force = rig.lacking(read)
        joint = int(np.argmax((force**2).mean(0)))
        if np.sqrt((force[:, joint] ** 2).mean()) > CLEAR * rig.left:
            panels.append(partial(_force, speed=speed[::2, joint], force=force[::2, joint], joint=rig.channels[joint]))
    with plt.rc_context({**LOOK, "font.size": 7.5, "axes.titlesize": 8, "figure.constrained_layout.use": False}):
        figure, axes = plt.subplots(1, len(panels), figsize=(3.2 * len(panels), 1.75), squeeze=False)
        for ax, draw in zip(axes[0], panels, strict=True):
            draw(ax)
        figure.subplots_adjust(0.2 / len(panels), 0.24, 0.98, 0.86, 0.3)  # left, bottom, right, top, between
        out = BytesIO()
        figure.savefig(out, format="png", dpi=110)
        plt.close(figure)
    return out.getvalue()


def _change(ax: Axes, rig: Rig, read: np.ndarray) -> None:
    change = read - rig.read
    column = int(np.argmax(np.sqrt((change**2).mean(0)) / (rig.read.std(0) + 1e-9)))
    ax.axhline(0, color=QUIET, linewidth=0.6)
    ax.plot(np.arange(len(read)) * PERIOD, change[:, column], color=IMPROVED)
    name = rig.channels[column]
    ax.set(xlabel="time (s)", title=f"change of the reading of {name} ({channel_unit(rig.simulator.base, name)})")


def _force(ax: Axes, speed: np.ndarray, force: np.ndarray, joint: str) -> None:
    low, high = np.quantile(force, [0.01, 0.99])
    room = 0.2 * (high - low)
    ax.axhline(0, color=QUIET, linewidth=0.6)
    ax.plot(speed, force, ".", color=IMPROVED, markersize=2)
    ax.set(xlabel="speed (rad/s)", ylim=(min(low - room, 0), max(high + room, 0)))
    ax.set_title(f"force that the model lacks at {joint} (N m)")
