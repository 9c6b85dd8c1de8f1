"""Measured orientations: q and -q are one rotation, but neither what lies between them nor their difference is."""

from collections.abc import Iterator
from typing import TypeGuard

import numpy as np

from fimpact.cases.channels import Channel
from fimpact.cases.enums import BALLQUAT, FRAMEQUAT
from fimpact.cases.errors import CaseError
from fimpact.cases.resampling import Series

OFF = 0.02  # that a quaternion may be longer or shorter than 1, by rounding


def quaternions(channels: list[Channel]) -> Iterator[tuple[Channel, slice]]:
    """Channels that are orientations, and their four columns among those of all."""
    column = 0
    for channel in channels:
        place = slice(column, column + len(channel.columns))
        column = place.stop
        if channel.type in (FRAMEQUAT, BALLQUAT):
            yield channel, place


def drop_invalid(seen: list[Series | None], channels: list[Channel], nan: str, where: str) -> list[Series | None]:
    """The series of all columns, (ny), without the rows in which an orientation is none, as 0 0 0 0 is.

    Raises:
        CaseError: there are such rows, and `nan` does not say that what is missing is in the file.
    """
    out = list(seen)
    for channel, place in quaternions(channels):
        own = seen[place]
        if not _same_times(own):
            continue
        length = np.linalg.norm(np.column_stack([one.value for one in own]), axis=1)
        off = np.abs(length - 1) > OFF
        if off.mean() > 0.5 or not off.any():
            continue
        if nan == "error":
            row = int(np.flatnonzero(off)[0])
            raise CaseError(
                f"{where}, '{channel.sensor}': the quaternion at {own[0].time[row]:.9g} s has length "
                f"{length[row]:.4g} ({off.sum()} such rows); allowed: 1; remove the rows, or, if they stand for "
                "samples that were not taken, write `nan: missing`"
            )
        out[place] = [Series(one.time[~off], one.value[~off]) for one in own]
    return out


def _same_times(own: list[Series | None]) -> TypeGuard[list[Series]]:
    known = [one for one in own if one]
    return len(known) == len(own) and all(np.array_equal(known[0].time, one.time) for one in known)


def continuous_sign(seen: list[Series | None], channels: list[Channel]) -> list[Series | None]:
    """The series of all columns, (ny), with orientations free of jumps of sign: between two samples such a jump would
    pass for half a turn."""
    out = list(seen)
    for _, place in quaternions(channels):
        own = seen[place]
        if _same_times(own):
            sign = _sign_flips(np.column_stack([one.value for one in own]))
            out[place] = [Series(one.time, sign * one.value) for one in own]
    return out


def unit(measured: np.ndarray, channels: list[Channel], where: str) -> np.ndarray:
    """`measured` (T, ny) with quaternions of length 1 and without jumps of sign.

    Raises:
        CaseError: their length is not 1.
    """
    out = measured.copy()
    for channel, place in quaternions(channels):
        out[:, place] = _unit(out[:, place], f"{where}, '{channel.sensor}'")
    return out


def _unit(quats: np.ndarray, where: str) -> np.ndarray:
    known = np.flatnonzero(np.isfinite(quats).all(axis=1))
    if not len(known):
        return quats
    length = np.linalg.norm(quats[known], axis=1)
    if abs(np.median(length) - 1) > OFF:
        raise CaseError(f"{where}: quaternions have length {np.median(length):.4g}, not 1; list the columns w, x, y, z")
    units = quats[known] / np.maximum(length, 1e-9)[:, None]
    out = quats.copy()
    out[known] = units * _sign_flips(units)[:, None]
    return out


def _sign_flips(quats: np.ndarray) -> np.ndarray:
    """Signs (n,) that make each of `quats` (n, 4) the nearer of the two that mean its rotation."""
    flips = np.sum(quats[1:] * quats[:-1], axis=1) < 0
    return np.cumprod(np.concatenate([[1.0], np.where(flips, -1.0, 1.0)]))[: len(quats)]
