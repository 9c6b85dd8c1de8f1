"""Numbers as a reader wants them: few digits, a true minus, a power of ten where it has to be."""

from collections.abc import Mapping
from typing import Any

import numpy as np


def short(value: float | None, digits: int = 3) -> str:
    """A number for a reader: three digits, a true minus, a power of ten where it has to be."""
    if value is None or not np.isfinite(value):
        return "–"
    mantissa, mark, exponent = f"{value:.{digits}g}".partition("e")
    return (mantissa + (_power(int(exponent)) if mark else "")).replace("-", "−")


def pair(value: float, half: float) -> str:
    """A value and its interval's half width, to the digits that the width supports."""
    if not (np.isfinite(half) and half > 0):
        return short(value)
    if half >= abs(value) * 1e3:
        return f"{short(value)} ± {short(half, 2)}"
    power = int(np.floor(np.log10(max(abs(value), half))))
    scale = power if not -3 <= power <= 4 else 0
    digits = max(0, scale - int(np.floor(np.log10(half))) + 1)
    body = f"{value / 10.0**scale:.{digits}f} ± {half / 10.0**scale:.{digits}f}".replace("-", "−")
    return f"({body}){_power(scale)}" if scale else body


def estimate(row: Mapping[str, Any], name: str = "value") -> str:
    """The value `name` of a row with half of its interval, as far as that is known, and its unit."""
    known = row["low"] is not None and row["high"] is not None
    text = pair(row[name], (row["high"] - row["low"]) / 2) if known else short(row[name])
    return f"{text} {row['unit']}".strip() if row["unit"] != "1" else text


def percent(value: float | None, digits: int = 0) -> str:
    """A share in percent, with a true minus; a dash where there is none."""
    return "–" if value is None else f"{100 * value:.{digits}f} %".replace("-", "−")


def _power(exponent: int) -> str:
    return "×10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
