"""How actuation and sensing are falsified on their way in and out of a world."""

import mujoco
import numpy as np
from scipy.signal import lfilter

from fimpact.benchmark.planting.ground_truth import World


def _command(world, site, change):
    """Change one motor's commands: change(command (runs, N), step in s)."""
    column = world.rig.naive.actuator(site).id

    def apply(drive, step):
        out = drive.copy()
        out[:, :, column] = change(drive[:, :, column], step)
        return out

    world.commands.append(apply)


def _before(world, command):
    """Command before the start of each run, (runs, 1): of a servo its first target."""
    return command[:, :1] * world.rig.serves()


def gain(world: World, site: str, change: float) -> None:
    """The motor gives 1 + `change` times the torque it should."""
    actuator = world.spec.actuator(site)
    actuator.gainprm, actuator.biasprm = actuator.gainprm * (1 + change), actuator.biasprm * (1 + change)


def saturation(world: World, site: str, limit: float) -> None:
    """The motor gives no more than `limit` N m."""
    actuator = world.spec.actuator(site)
    actuator.forcelimited, actuator.forcerange = True, [-limit, limit]


def torque_offset(world: World, site: str, offset: float) -> None:
    """The motor adds a constant torque, N m; its gear is 1."""
    actuator = world.spec.actuator(site)
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.biasprm = actuator.biasprm + offset * np.eye(10)[0]


def servo_kp(world: World, site: str, change: float) -> None:
    """The servo's gain on the error of its position is 1 + `change` times what it should be."""
    actuator, alone = world.spec.actuator(site), np.eye(10)
    actuator.gainprm = actuator.gainprm * (1 + change * alone[0])
    actuator.biasprm = actuator.biasprm * (1 + change * (alone[0] + alone[1]))


def servo_kv(world: World, site: str, change: float) -> None:
    """The servo's gain on its speed is 1 + `change` times what it should be."""
    actuator = world.spec.actuator(site)
    actuator.biasprm = actuator.biasprm * (1 + change * np.eye(10)[2])


def target_resolution(world: World, site: str, step: float) -> None:
    """Targets are rounded to whole steps, rad."""
    _command(world, site, lambda command, _: step * np.round(command / step))


def command_delay(world: World, site: str, delay: float) -> None:
    """Commands arrive `delay` s late; before the start a servo holds its first target, and nothing else is
    commanded."""

    def late(command, step):
        whole, part = divmod(delay / step, 1)
        before = np.repeat(_before(world, command), int(whole) + 1, axis=1)
        padded = np.concatenate([before, command], axis=1)
        count = command.shape[1]
        return (1 - part) * padded[:, 1 : 1 + count] + part * padded[:, :count]

    _command(world, site, late)


def actuator_lag(world: World, site: str, time: float) -> None:
    """The torque follows the command with a time constant of `time` s."""

    def lag(command, step):
        keep = time / (time + step)  # implicit Euler, which lags by `time` at any step
        return lfilter([1 - keep], [1, -keep], command, axis=1, zi=keep * _before(world, command))[0]

    _command(world, site, lag)


def varying_gain(world: World, site: str, depth: float, period: float, phase: float) -> None:
    """The motor's gain swings by `depth` with a `period` of s. Outside the catalogue."""

    def swing(command, step):
        return command * (1 + depth * np.sin(2 * np.pi * np.arange(command.shape[1]) * step / period + phase))

    _command(world, site, swing)


def cross_coupling(world: World, site: str, coefficient: float) -> None:
    """One motor's torque leaks into the next joint. Outside the catalogue."""
    column = world.rig.naive.actuator(site).id
    source = (column + 1) % world.rig.naive.nu

    def leak(drive, step):
        out = drive.copy()
        out[:, :, column] += coefficient * drive[:, :, source]
        return out

    world.commands.append(leak)


def _columns(world, site):
    """Columns of one channel, of every component of a sensor, or of all."""
    return [i for i, c in enumerate(world.rig.channels) if site in ("all", c, c.partition("[")[0])]


def _sensed(world, site, change):
    columns = _columns(world, site)

    def apply(samples):
        out = samples.copy()
        out[:, :, columns] = change(samples[:, :, columns])
        return out

    world.senses.append(apply)


def bias(world: World, site: str, offset: float) -> None:
    """The channel reads `offset` too much."""
    _sensed(world, site, lambda y: y + offset)


def scale(world: World, site: str, change: float) -> None:
    """The channel, or sensor, reads 1 + `change` times the truth."""
    _sensed(world, site, lambda y: (1 + change) * y)


def sensor_delay(world: World, site: str, delay: float) -> None:
    """The channel, or all of them, is `delay` s late."""
    world.delays[_columns(world, site)] += delay


def clock_drift(world: World, site: str, rate: float) -> None:
    """The recorder's clock runs fast by `rate` s/s: what it stamps t happened at (1 - rate) t."""
    world.drift -= rate


def misalignment(world: World, site: str, turn_x: float = 0.0, turn_y: float = 0.0, turn_z: float = 0.0) -> None:
    """A sensor of which two axes are recorded is turned, rad; only the turn about the third shows."""
    columns = _columns(world, site)
    first, second = (int(world.rig.channels[i][-2]) for i in columns)
    turn = (turn_x, turn_y, turn_z)[3 - first - second] * (1 if (second - first) == 1 else -1)
    c, s = np.cos(turn), np.sin(turn)

    def apply(samples):
        out = samples.copy()
        out[:, :, columns] = samples[:, :, columns] @ np.array([[c, -s], [s, c]])
        return out

    world.senses.append(apply)


def bent_scale(world: World, site: str, coefficient: float) -> None:
    """The channel bends: its reading lacks a share that grows with the reading's square. Outside the catalogue."""
    _sensed(world, site, lambda y: y - coefficient * y**3)
