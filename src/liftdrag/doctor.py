"""The engines of this machine, and whether each computes contacts right."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from liftdrag.deck.dialect import Contact
from liftdrag.engines import spatial
from liftdrag.engines.base import About, Engine
from liftdrag.engines.probes import Probe, Subject, probe
from liftdrag.errors import InputError

GRAINS = Subject(
    Contact(
        youngs_modulus=5e6,
        poisson_ratio=0.45,
        restitution=0.6,
        friction=0.5,
        radius=0.75e-3,
        wall_radius=2.475e-3,
    ),
    density=2500.0,
)
"""The grains and the thin cylinder of Guillard et al. 2014, which the probes are made with."""


@dataclass(frozen=True)
class Patient:
    """An engine, what it was built with, its launcher and its probes; or why it is `missing`."""

    name: str
    about: About | None
    launcher: str
    packages: tuple[str, ...]
    probes: tuple[Probe, ...]
    missing: str = ""
    named: bool = False

    @property
    def healthy(self) -> bool:
        """Whether no probe failed; one that was named, and is missing, is not healthy."""
        return all(found.passed for found in self.probes) and not (self.missing and self.named)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        found = asdict(self) | {"probes": [found.to_dict() for found in self.probes]}
        if self.about is not None:
            found["about"]["path"] = str(self.about.path)
        return found | {"healthy": self.healthy and not self.missing}


def examine(
    name: str, path: Path | None = None, tell: Callable[[str], None] = lambda _: None
) -> Patient:
    """Probe an engine, with the grains of the paper; `tell` hears of each probe.

    Raises InputError when there is no engine of that name; one that is not installed is a
    patient who is `missing`.
    """
    chosen = spatial(name, path)
    try:
        about = chosen.about()
    except InputError as error:
        named = path is not None or f"LIFTDRAG_{name.upper()}" in os.environ
        return Patient(name, None, "", (), (), str(error), named)
    launcher, found = _launcher(chosen), []
    for probed in probe(chosen, GRAINS):
        tell(f"{name}: {probed.name} {probed.finding}")
        found.append(probed)
    return Patient(name, about, launcher, chosen.packages(), tuple(found))


def _launcher(engine: Engine) -> str:
    try:
        return str(engine.launcher())
    except InputError as error:
        return str(error)
