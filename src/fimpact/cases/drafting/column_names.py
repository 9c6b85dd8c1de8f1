"""What the name of a column says: its words, its unit, its number, and which of the MJCF's names it has in it."""

import re

from fimpact.cases.readers.columns import Column

OPEN = "?"  # where only the user knows the unit
UNITS: tuple[str, ...] = (
    "deg/s",
    "rad/s",
    "mm/s",
    "m/s",
    "rpm",
    "mN m",
    "N m",
    "Nm",
    "deg",
    "rad",
    "rev",
    "counts",
    "mm",
    "ms",
    "us",
    "ns",
)
UNITS += ("m", "s", "N", "V", "A")
SPELT = {"degs": "deg/s", "rads": "rad/s", "degrees": "deg", "radians": "rad", "°": "deg"}
SPELT |= {"volt": "V", "volts": "V", "amps": "A"}
SPELT |= {one.replace(" ", "").lower(): one for one in reversed(UNITS) if len(one) > 1}
APART = {re.sub("[/ ]", "_", one).lower(): one for one in UNITS if re.search("[/ ]", one)}  # as in speed_m_s


def words(name: str) -> set[str]:
    """Words of a column name in small letters; numbers count as words: ``pos_meas1 [deg]`` is pos, meas, 1, deg."""
    return set(re.findall(r"[^\W\d_]+|\d+", re.sub(r"(?<=[a-zß-ÿ])(?=[A-Z])", " ", name).lower()))


def unit(name: str) -> str:
    """The unit that a column name ends with, as in ``elbow [deg]``, ``elbow (deg)``, ``elbow_deg`` or
    ``elbow_rad_s``; else `OPEN`."""
    bracket = re.search(r"[\[(]([^\])]+)[\])]\s*$", name)
    parts = name.split("_")[1:]
    if not bracket and "_".join(parts[-2:]).lower() in APART:
        return APART["_".join(parts[-2:]).lower()]
    ending = bracket.group(1) if bracket else "".join(parts[-1:]) or (name if len(name) > 2 else "")
    return ending if ending in UNITS else SPELT.get(re.sub(r"[\s*·.]", "", ending).lower(), OPEN)


def best(column: str, names: list[str]) -> str:
    """The name all whose words the column has, the one with most of them; of no words at all, none."""
    fitting = [name for name in names if words(name) and words(name) <= words(column)]
    return max(fitting, key=lambda name: (len(words(name)), -names.index(name)), default="")


def named(column: str, names: list[str], table: list[Column]) -> str:
    """The name that fits, or that of the number in the column's name: ``pos2`` is the second joint of the MJCF, and
    ``q[1]`` as well, for indices of arrays count from 0, as all do that have a 0 among them."""
    found, numbers = best(column, names), _numbers(column)
    if found or len(numbers) != 1:
        return found
    stem = re.sub(r"\d+", "#", column)
    from_zero = any(re.sub(r"\d+", "#", one.name) == stem and _numbers(one.name) == [0] for one in table)
    place = numbers[0] + (1 if from_zero or re.search(r"[\[{]\d+[\]}]", column) else 0)
    return names[place - 1] if 1 <= place <= len(names) else ""


def _numbers(column: str) -> list[int]:
    return [int(word) for word in words(column) if word.isdecimal()]
