"""Units as a case declares them, converted and never guessed.

Angle and counts are dimensions of their own here, unlike in SI: rad is not 1 and Hz is not rad/s, so that a number
of encoder counts or revolutions can never pass for an angle in radians.
"""

import re
from functools import cache
from math import isfinite, tau

from fimpact.cases.errors import CaseError, summarise_exception

PREFIXES = {"nano": "1e-9 = n-", "micro": "1e-6 = µ- = u-", "milli": "1e-3 = m-", "centi": "1e-2 = c-"}
PREFIXES |= {"kilo": "1e3 = k-", "mega": "1e6 = M-"}
BASES: tuple[str, ...] = (
    "meter = [length] = m",
    "second = [time] = s",
    "kilogram = [mass] = kg",
    "radian = [angle] = rad",
)
BASES += ("volt = [voltage] = V", "ampere = [current] = A", "count = [counting] = counts")
BASES += ("percent = [share] = pct",)  # of a range that the log does not know
DERIVED = (
    "gram = 1e-3 * kilogram = g",
    f"degree = {tau / 360!r} * radian = deg",
    f"revolution = {tau!r} * radian = rev",
    "minute = 60 * second = min",
    "rpm = revolution / minute = RPM",
    "hertz = 1 / second = Hz",
    "newton = kilogram * meter / second ** 2 = N",
    "newton_meter = newton * meter = Nm",
    "g_n = 9.80665 * meter / second ** 2 = standard_gravity",
    "inch = 0.0254 * meter",
    "foot = 0.3048 * meter = ft",
    "pound_force = 4.4482216152605 * newton = lbf",
)
LONGEST = 80  # letters of a unit or a gain
EXAMPLES = "m, mm, rad, deg, rev, counts, percent, s, ms, m/s, rad/s, deg/s, rpm, m/s^2, g_n, N, N m, mN m, V, A, 1"
STRANGE = re.compile(r"[^\w\s*/^().+-]")  # would be left out without a word


@cache
def _registry():
    import pint

    registry = pint.UnitRegistry(None)
    for name, rest in PREFIXES.items():
        registry.define(f"{name}- = {rest}")
    for definition in (*BASES, *DERIVED):
        registry.define(definition)
    return registry


def _quantity(text: str, where: str):
    plain = text.replace("°", " deg").replace("·", "*").replace("\u03bc", "µ").replace("%", "percent").strip()
    try:
        if len(plain) > LONGEST or _is_tower(plain):
            raise ValueError("too long, or a power of a power or beyond 9")
        if strange := STRANGE.search(plain):
            raise ValueError(f"no unit has '{strange[0]}'")
        return _registry().Quantity(plain) if plain not in ("1", "") else _registry().Quantity(1.0, "")
    except Exception as error:
        why = f" ({summarise_exception(error)})" if str(error) else ""
        raise CaseError(
            f"{where} is '{text}', which is not a unit{why}; allowed for example: {EXAMPLES}; "
            "declare the unit that the file uses"
        ) from None


def _is_tower(text: str) -> bool:
    """Whether a power has more than one digit or a power of its own: it would be evaluated for ever."""
    powers = re.split(r"\*\*|\^", text)[1:]
    nested = any(not power.strip("()+-0123456789. ") for power in powers[:-1])
    return nested or not all(re.match(r"\s*\(?\s*[-+]?\d\s*\)?(?![\d.])", power) for power in powers)


def factor(text: str, wanted: str | None, where: str, gain: str | None = None, per_rev: float | None = None) -> float:
    """By what a number in the unit `text` is multiplied to be in the unit `wanted`.

    Args:
        text: declared unit, for example ``deg/s``.
        wanted: unit of the MJCF quantity; None: its SI unit, whatever the dimension.
        where: key of the case, for messages.
        gain: a quantity by which the number is multiplied, such as ``35.15 N/V``.
        per_rev: counts in one revolution, where the unit has counts.

    Raises:
        CaseError: not a unit, or of another dimension than `wanted`.
    """
    value = 1 * _quantity(text, f"{where}.unit")
    if per_rev:
        value = value * _quantity(f"{tau / per_rev!r} rad/count", where)
    if gain:
        value = value * _quantity(gain, f"{where}.gain")
    try:
        out = value.to_base_units() if wanted is None else value.to(_quantity(wanted, where).units)
    except Exception:
        raise CaseError(_mismatch(text, wanted, where, value, gain)) from None
    if not (isfinite(out.magnitude) and out.magnitude):
        raise CaseError(f"{where}: unit and gain multiply to {out.magnitude}; allowed: finite and not 0; correct them")
    return float(out.magnitude)


def _mismatch(text: str, wanted: str | None, where: str, value, gain: str | None) -> str:
    got = f"{text!r}" + (f" (with its gain {value.units:~})" if gain else "")
    helps = "counts_per_rev" if "count" in str(value.units) else "gain"
    if "percent" in str(value.units):
        return (
            f"{where}.unit is {got}, but the MJCF has this in {wanted!r}; say what one percent of the "
            f"calibrated range is: `gain: 0.0157 {wanted}/percent`, if -100..100 stands for -1.57..1.57 {wanted}"
        )
    return (
        f"{where}.unit is {got}, but the MJCF has this in {wanted!r}; allowed: any unit of the same dimension; "
        f"correct the unit, or declare the conversion with `{helps}`"
    )


def same_dimension(text: str, wanted: str) -> bool:
    """Whether `text` is a unit of the dimension of `wanted`."""
    try:
        return _quantity(text, "unit").check(_quantity(wanted, "unit").dimensionality)
    except CaseError:
        return False
