"""All the two-body tests of an engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from liftdrag.engines.base import Engine
from liftdrag.verify.check import Check
from liftdrag.verify.chung_ooi import checks
from liftdrag.verify.convergence import Convergence, convergence


@dataclass(frozen=True)
class Verified:
    """What the tests of an engine found."""

    engine: str
    version: str
    checks: tuple[Check, ...]
    convergence: tuple[Convergence, ...]

    @property
    def passed(self) -> bool:
        """Whether every error is within its bound."""
        return all(check.passed for check in self.checks)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "engine": self.engine,
            "version": self.version,
            "passed": self.passed,
            "checks": [check.to_dict() for check in self.checks],
            "convergence": [row.to_dict() for row in self.convergence],
        }


def verified(engine: Engine, tell: Callable[[str], None] = lambda _: None) -> Verified:
    """Run the tests on an engine; `tell` hears of each. Raises RunFailed when one cannot run."""
    found = []
    for check in checks(engine):
        tell(f"{check.test}: {check.quantity} {check.measured:.6g} {check.unit}")
        found.append(check)
    tell("order of convergence")
    rows = tuple(convergence(engine))
    return Verified(engine.name, engine.about().version, tuple(found), rows)
