"""How well a run's answer must be known for it to end early: the table `[stop]` of a case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field, ValidationError, ValidatorFunctionWrapHandler, WrapValidator

from liftdrag.errors import CaseError
from liftdrag.scene.model import Part

Error = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


def _in_one_sentence(sentence: str) -> WrapValidator:
    """Whatever is wrong with a value that may be of two kinds, said once."""

    def checked(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
        try:
            return check(value)
        except ValidationError:
            raise ValueError(sentence) from None

    return WrapValidator(checked)


Errors = Annotated[
    Error | dict[str, Error],
    _in_one_sentence("this should be a positive number, or a table of one for each quantity"),
]
Names = Annotated[
    str | list[str], _in_one_sentence("this should be the name of a quantity, or a list of names")
]


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

    quantity: Names | None = None
    relative_error: Errors | None = None
    absolute_error: Errors | None = None

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
