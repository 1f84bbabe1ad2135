"""Field types of a case: numbers in SI, or text with a unit.

A length may also be a multiple of the grain diameter ("140 d"; of grains that are no spheres
"30 d_v") or of the intruder's ("8 D"); their values come in the validation context as `d`, `d_v`
and `D`.
"""

from __future__ import annotations

import re
from functools import cache
from math import isfinite
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ValidationInfo, WithJsonSchema

from liftdrag.errors import shown

MAX_TEXT = 60

_TEXT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*(.*?)\s*", re.ASCII)
_UNIT = re.compile(r"[A-Za-zµμ]{1,20}(\^?-?\d)?(\s*[*/ ]\s*[A-Za-zµμ]{1,20}(\^?-?\d)?){0,4}")
_DIAMETERS = {"d": "grains.diameter", "d_v": "grains.diameter", "D": "intruder.diameter"}


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(cache_folder=None)


def _convert(number: float, unit: str, si: str) -> float:
    import pint

    example = f"write a plain number in {si}, or text such as '{_EXAMPLES[si]}'"
    if not _UNIT.fullmatch(unit):
        raise ValueError(f"{shown(unit)} is not a unit; {example}")
    try:
        return float(_registry().Quantity(number, unit).to(si).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"the unit {unit!r} does not measure this; {example}") from None
    except (pint.PintError, AttributeError, ValueError, TypeError):
        raise ValueError(f"{unit!r} is not a known unit; {example}") from None


_EXAMPLES = {
    "m": "1.5 mm",
    "s": "10 us",
    "m/s": "0.1 m/s",
    "kg": "100 g",
    "kg/m^3": "2.5 g/cm^3",
    "Pa": "5 MPa",
    "N/m": "8 kN/m",
    "1/s": "100 Hz",
}


def _number(value: object, si: str, diameters: dict[str, float]) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"this is not a quantity; write a number in {si}, or text with a unit")
    if not isinstance(value, str):
        return _finite(value)
    match = _TEXT.fullmatch(value) if len(value) <= MAX_TEXT else None
    if match is None:
        raise ValueError(f"this text is not a number with a unit; write '{_EXAMPLES[si]}'")
    number, unit = float(match[1]), match[2]
    if si == "m" and unit in _DIAMETERS:
        return _finite(number * _diameter(unit, diameters))
    return _finite(_convert(number, unit, si) if unit else number)


def _diameter(symbol: str, diameters: dict[str, float]) -> float:
    if symbol not in diameters:
        name = _DIAMETERS[symbol]
        raise ValueError(f"{symbol!r} stands for {name}, which is not known here; write metres")
    return diameters[symbol]


def _finite(value: float) -> float:
    try:
        number = float(value)
    except OverflowError:
        number = float("inf")
    if not isfinite(number):
        raise ValueError("this is not a finite number; write a finite one")
    return float(f"{number:.12g}")


def _within(si: str, least: float, most: float) -> AfterValidator:
    """Refuses what is not positive, and what can only be a slip of units."""

    def validate(value: float) -> float:
        if value <= 0.0:
            raise ValueError(f"this should be greater than 0; write a positive number in {si}")
        if not least <= value <= most:
            raise ValueError(
                f"no granular scene has {value:.3g} {si} here; "
                f"check the unit, {least:g} to {most:g} {si} is accepted"
            )
        return value

    return AfterValidator(validate)


def _in(si: str) -> BeforeValidator:
    def validate(value: object, info: ValidationInfo) -> float:
        return _number(value, si, info.context or {})

    return BeforeValidator(validate)


def _schema(si: str) -> WithJsonSchema:
    text = f"A number in {si}, or text with a unit, such as '{_EXAMPLES[si]}'."
    return WithJsonSchema({"type": ["number", "string"], "description": text})


Length = Annotated[float, _within("m", 1e-7, 1e4), _in("m"), _schema("m")]
Time = Annotated[float, _within("s", 1e-12, 1e6), _in("s"), _schema("s")]
Speed = Annotated[float, _within("m/s", 1e-9, 1e3), _in("m/s"), _schema("m/s")]
Density = Annotated[float, _within("kg/m^3", 1e-2, 1e6), _in("kg/m^3"), _schema("kg/m^3")]
Modulus = Annotated[float, _within("Pa", 1.0, 1e13), _in("Pa"), _schema("Pa")]
Mass = Annotated[float, _within("kg", 1e-15, 1e9), _in("kg"), _schema("kg")]
Stiffness = Annotated[float, _within("N/m", 1e-9, 1e12), _in("N/m"), _schema("N/m")]
Rate = Annotated[float, _within("1/s", 1e-9, 1e9), _in("1/s"), _schema("1/s")]
