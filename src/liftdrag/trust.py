"""Whether an engine may be used: its probes, and the failures that a user ignores."""

from __future__ import annotations

from collections.abc import Sequence

from liftdrag.engines.base import Engine
from liftdrag.engines.known import probed
from liftdrag.engines.probes import Probe, Subject
from liftdrag.errors import InputError


def trusted(
    engine: Engine, subject: Subject, names: tuple[str, ...], ignored: Sequence[str]
) -> tuple[list[Probe], list[str]]:
    """What the probes of these names find with these grains, and a warning for each ignored.

    Raises InputError for a failure that is not in `ignored`.
    """
    probes = probed(engine, subject, names)
    return probes, _alarms(engine, probes, ignored)


def _alarms(engine: Engine, probes: Sequence[Probe], ignored: Sequence[str]) -> list[str]:
    failed = [found for found in probes if not found.passed]
    for found in failed:
        if found.name not in ignored:
            raise InputError(
                f"The engine {engine.name} fails the probe {found.name} ({found.finding}); choose "
                f"another engine, or run at your own risk with --ignore-probe {found.name}."
            )
    return [
        f"THE ENGINE IS WRONG: {engine.name} fails the probe {found.name} ({found.finding}), "
        "which was ignored."
        for found in failed
    ]
