"""How well a run's answer must be known for it to end early: the table `[stop]` of a case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from liftdrag.errors import CaseError
from liftdrag.scene.model import Part

Error = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


@dataclass(frozen=True)
class Target:
    """A standard error that is good enough: `relative` to the mean, or `absolute` in its unit.

    Where both are given, either will do; zero stands for one that is not.
    """

    relative: float
    absolute: float


class Stop(Part):
    """The errors of one or more quantities at which a run may end.

    An error is one number for all of them, or a table with a number for each.
    """

    quantity: str | list[str] | None = None
    relative_error: Error | dict[str, Error] | None = None
    absolute_error: Error | dict[str, Error] | None = None

    def targets(self, known: Sequence[str]) -> Mapping[str, Target]:
        """The target of each quantity of `known` that is asked for, by default the first.

        Raises CaseError for a quantity that is not known, or has no error to reach.
        """
        names = self.quantity if isinstance(self.quantity, list) else [self.quantity or known[0]]
        if not names:
            raise CaseError(
                "stop.quantity", None, "this list is empty", "name one, or leave it out"
            )
        for name in names:
            _check_known("stop.quantity", name, known)
        for key, given in self._errors().items():
            for name in given if isinstance(given, dict) else ():
                _check_known(f"stop.{key}", name, names)
        return {name: self._target(name) for name in names}

    def _errors(self) -> dict[str, float | dict[str, float] | None]:
        return {"relative_error": self.relative_error, "absolute_error": self.absolute_error}

    def _target(self, name: str) -> Target:
        relative, absolute = (_of(given, name) for given in self._errors().values())
        if not relative and not absolute:
            raise CaseError(
                "stop.relative_error",
                None,
                f"nothing says how well the {name} must be known",
                "add relative_error = 0.05, or an absolute_error in its unit",
            )
        return Target(relative, absolute)


def _of(given: float | dict[str, float] | None, name: str) -> float:
    return given.get(name, 0.0) if isinstance(given, dict) else given or 0.0


def _check_known(key: str, name: str, known: Sequence[str]) -> None:
    if name not in known:
        raise CaseError(
            key, name, "no run can be stopped by this", f"choose one of {', '.join(known)}"
        )
