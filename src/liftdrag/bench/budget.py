"""A budget of time, as text."""

from __future__ import annotations

import re

from liftdrag.errors import InputError, shown

_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0}

MOST = 1e6
"""The largest number before a unit."""


def seconds(text: str, option: str = "--budget") -> float:
    """The seconds (s) of "90s", "30m" or "1.5h", given by an option. Raises InputError."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", text.strip())
    if match is None or not 0.0 < float(match[1]) < MOST:
        raise InputError(f"{option} {shown(text)} is no time; write it as 90s, 30m or 2h.")
    return float(match[1]) * _UNITS[match[2]]
