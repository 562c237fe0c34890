"""Units that data state, compared as units: `meters` and `m`, `um` and `µm`, `mm/s` and `mm s-1`."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

AXES, TIME = ("x", "y"), "time"
SPACE = (*AXES, "z")  # of data in three dimensions
UNKNOWN = "?"  # what names begin with that pint does not know
MAX_TEXT = 100  # characters of a unit
# what neither pint nor its aliases mean by a name as data have it: pint's px is a length, its hertz 1 rad/s
_KNOWN_AS = {"px": "pixel", "pix": "pixel", "°": "degree", "'": "arcminute", '"': "arcsecond"}
_NAMED_RATES = (
    (r"\b(Hz|hertz)\b", "turn/s"),
    (r"\b(knots?|kts?)\b", "nautical_mile/h"),
    (r"\b(kph|kmh)\b", "km/h"),
    (r"\bmph\b", "mile/h"),
)
_DEGREES = re.compile(r"degrees?_?(north|south|east|west|[NSEW])")
_TIMES = {1e-6: "µs", 1e-3: "ms", 1.0: "s", 60.0: "min", 3600.0: "h", 86400.0: "d"}
_LENGTHS = {1e-9: "nm", 1e-6: "µm", 1e-3: "mm", 1e-2: "cm", 1.0: "m", 1e3: "km"}
_EXPONENT = r"(?:\^|\*\*)?\s*\(?([-+]?\d{1,2})?\)?"
_NUMBER, _NAME = r"(\d+\.?\d*(?:e[-+]?\d+)?(?![\d.]))", r"([^\W\d][^\W\d]*|[%°'\"])"
_FACTOR = re.compile(rf"\s*([*/.]?)\s*(?:{_NUMBER}|{_NAME})\s*{_EXPONENT}\s*")
_SUPERSCRIPTS = str.maketrans("⁻⁺⁰¹²³⁴⁵⁶⁷⁸⁹µ−·⋅×", "-+0123456789μ-***")


class Unit(NamedTuple):
    """A unit as `factor` of base units, and apart from it the factor of its time."""

    factor: float
    powers: tuple[tuple[str, float], ...]  # of the base units, but for time
    time: float  # [s]; 1 where there is none
    time_power: float


BARE = Unit(1.0, (), 1.0, 0.0)  # of numbers without dimensions


def unit_of(text: str) -> Unit:
    """The unit that a text states; names that pint does not know are units of their own.

    Raises ValueError where the text is none.
    """
    plain = re.sub(r"[{}]", "", text.translate(_SUPERSCRIPTS)).replace("$", "")
    plain = re.sub(r"\(([^\W\d]+)\)", r"\1", re.sub(r"\s+per\s+", "/", plain.strip()))
    for pattern, written in _NAMED_RATES:
        plain = re.sub(pattern, written, plain)
    factor, time, powers, at = 1.0, 1.0, dict[str, float](), 0
    while at < len(plain) and len(plain) <= MAX_TEXT:
        match = _FACTOR.match(plain, at)
        if match is None or match.end() == at:
            break
        sign, number, name, exponent = match.groups()
        power = int(exponent or 1) * (-1 if sign == "/" else 1)
        each, base = (float(number), {}) if number else _named(name)
        try:
            scale = each**power
        except (OverflowError, ZeroDivisionError):
            break
        if set(base) == {"second"}:
            time *= scale
        else:
            factor *= scale
        for key, exponent_of_base in base.items():
            powers[key] = powers.get(key, 0.0) + exponent_of_base * power
        at = match.end()
    else:
        if at == len(plain) > 0:
            time_power = powers.pop("second", 0.0)
            kept = tuple(sorted((key, power) for key, power in powers.items() if power))
            return Unit(factor, kept, time, time_power)
    raise ValueError(f"units must be names with whole powers, as m s-1, got {text[:MAX_TEXT]!r}")


@functools.cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


@functools.lru_cache(maxsize=256)
def _named(name: str) -> tuple[float, dict[str, float]]:
    """Factor and base units of one name."""
    known = "degree" if _DEGREES.fullmatch(name) else _KNOWN_AS.get(name, name)
    registry = _registry()
    for tried in (known, known.lower()):
        try:
            quantity = registry.Quantity(1.0, registry.parse_units(tried)).to_root_units()
        except Exception:  # pint meets what it does not know with errors of several kinds
            continue
        return float(quantity.magnitude), {str(key): float(power) for key, power in quantity.unit_items()}
    return 1.0, {UNKNOWN + name: 1.0}


def same(one: float, other: float) -> bool:
    """Whether factors are the same but for rounding."""
    return abs(one - other) <= 1e-9 * abs(other)


def check_units(
    units: Mapping[str, str], velocity: Sequence[str] = (), spin: str | None = None
) -> str | None:
    """The unit of length, where stated; raises ValueError where units contradict each other.

    Coordinates are in one unit, velocities in it per time, a spin in radians per the same time, and so is a
    time axis.
    """
    rates = [*velocity, *([] if spin is None else [spin])]
    texts = {name: units[name] for name in (*SPACE, TIME, *rates) if name in units}
    texts = {name: re.sub(r"\s+since\s.*", "", text).strip() for name, text in texts.items()}
    known: dict[str, Unit] = {}
    for name, text in texts.items():
        try:
            known |= {name: unit_of(text)} if text else {}
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
    for names in (SPACE, velocity):
        _check_same({name: known[name] for name in names if name in known}, texts)
    axis = next((name for name in SPACE if name in known), None)
    length = None if axis is None else known[axis]
    time = None
    if TIME in known and known[TIME] != BARE:
        if known[TIME].powers or known[TIME].time_power != 1:
            raise ValueError(f"{TIME} must be in a unit of time, got {texts[TIME]!r}")
        time = known[TIME].factor * known[TIME].time, TIME
    for name in rates:
        if name in known and not _says_nothing(known[name], name == spin, length):
            thing = "radians" if name == spin else "a length" if axis is None else texts[axis]
            rule = "" if name == spin or axis is None else " like x and y"
            if not _is_rate(known[name], name == spin, length):
                raise ValueError(f"{name} must be in {thing} per time{rule}, got {texts[name]!r}")
            own = 1 / known[name].time
            if time is not None and not same(own, time[0]):
                per = f"{_TIMES.get(time[0], f'{time[0]:g} s')} like {time[1]}"
                raise ValueError(f"{name} must be in {thing} per {per}, got {texts[name]!r}")
            time = time or (own, name)
    return None if axis is None else _length(known[axis], texts[axis])


def _check_same(found: dict[str, Unit], texts: Mapping[str, str]) -> None:
    units = list(found.values())
    if not all(
        (one.powers, one.time_power) == (units[0].powers, units[0].time_power)
        and same(one.factor * one.time, units[0].factor * units[0].time)
        for one in units
    ):
        stated = " and ".join(repr(texts[name]) for name in found)
        raise ValueError(f"{' and '.join(found)} must have the same units, got {stated}")


def _says_nothing(unit: Unit, turns: bool, length: Unit | None) -> bool:
    """Whether a rate is one of data without dimensions, or in a unit that nobody knows."""
    unknown = all(name.startswith(UNKNOWN) for name, _ in unit.powers) and not unit.time_power
    return (unit == BARE and (turns or length in (None, BARE))) or (unknown and unit.powers != ())


def _is_rate(unit: Unit, turns: bool, length: Unit | None) -> bool:
    """Whether a unit is the length, or radians, per time."""
    if unit.time_power != -1:
        return False
    if turns:
        return unit.powers in ((), (("radian", 1.0),)) and same(unit.factor, 1.0)
    if length is None:
        return len(unit.powers) == 1 and unit.powers[0][1] == 1
    return unit.powers == length.powers and same(unit.factor, length.factor)


def _length(unit: Unit, text: str) -> str:
    """A unit of length by one name, however it was written."""
    if unit.powers == (("meter", 1.0),) and not unit.time_power:
        near = next((name for size, name in _LENGTHS.items() if same(unit.factor, size)), None)
        return near or f"{unit.factor:.12g} m"
    return " ".join(key for key, _ in unit.powers) if same(unit.factor, 1.0) and unit.powers else text
