"""A case file (TOML) into a checked `Scene`."""

from __future__ import annotations

import copy
import difflib
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError

from liftdrag.errors import CaseError, InputError, escaped, shown
from liftdrag.files import is_file, read_bytes
from liftdrag.refusals import NO_TABLE, in_words, refusal
from liftdrag.scene import SCENES, Scene
from liftdrag.scene.quantities import Length

MAX_BYTES = 100_000
"""The largest case or study file."""

MAX_LINE = 1000
"""Characters of its longest line: a key with thousands of dots takes Python hours to read."""

_NUMBER = r"[-+]?+\d++(?:\.\d++)?+(?:[eE][-+]?+\d++)?+"
_NUMBERS = re.compile(rf"\[(?:\s*+{_NUMBER}\s*+,)*+\s*+(?:{_NUMBER}\s*+)?+\]", re.ASCII)
"""A list of numbers, which has commas where a key has its dots; read in one go, without a retry."""

MOST_ERRORS = 10
"""Wrong keys that get a sentence each."""


@dataclass(frozen=True)
class Case:
    """A case file as read: its name and its tables; `scene` checks and resolves them."""

    name: str
    tables: Mapping[str, Any]

    @cached_property
    def scene(self) -> Scene:
        """The checked scene, in SI units. Raises InputError, a sentence for each wrong key."""
        return _scene(self.tables)

    def set(self, key: str, value: object) -> Case:
        """A new case in which the dotted `key` ("intruder.depth") has `value` ("8 D").

        Items of a list have numbers ("species.0.share"). Raises CaseError where there is no such.
        """
        tables = copy.deepcopy(dict(self.tables))
        *path, last = _split(key)
        place: Any = tables
        for name in path:
            if isinstance(place, dict):
                place.setdefault(name, {})
            place = place[_index(place, name, key, value)]
            if not isinstance(place, dict | list):
                raise CaseError(key, None, f"{name} is not a table of the case", _see_schema())
        place[_index(place, last, key, value)] = value
        return Case(self.name, tables)


def load(case: str | Path) -> Case:
    """The case of a path, or a packaged one by its name ("quick"). Raises InputError."""
    path = Path(case)
    if path.suffix == ".toml" or is_file(path):
        return Case(path.stem, parse(read_text(path, "case"), f"case {escaped(str(path))}"))
    packaged_cases = packaged()
    if str(case) not in packaged_cases:
        raise InputError(f"There is no case {shown(str(case))}: {_nearest_case(str(case))}")
    return Case(str(case), parse(packaged_cases[str(case)].read_text("utf-8"), f"case {case}"))


def packaged() -> dict[str, Traversable]:
    """The packaged cases: name -> file."""
    return dict(sorted(_walk(resources.files("liftdrag.cases"), "")))


def with_settings(case: Case, settings: list[str]) -> Case:
    """The case after command-line settings KEY=VALUE; a VALUE that is not TOML is text."""
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals:
            raise InputError(f"--set {setting!r} has no '='; write --set KEY=VALUE.")
        case = case.set(key.strip(), _value(text.strip()))
    return case


def _walk(folder: Traversable, prefix: str) -> Iterator[tuple[str, Traversable]]:
    for entry in folder.iterdir():
        if entry.is_dir():
            yield from _walk(entry, f"{prefix}{entry.name}/")
        elif entry.name.endswith(".toml"):
            yield prefix + entry.name.removesuffix(".toml"), entry


def _nearest_case(name: str) -> str:
    close = difflib.get_close_matches(name, packaged(), n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"{hint}'liftdrag cases' lists the packaged ones, and a path should end in .toml."


def read_text(path: Path, kind: str) -> str:
    """The text of a case or study file. Raises InputError when it cannot be one."""
    name = escaped(str(path))
    try:
        text = read_bytes(path, MAX_BYTES).decode("utf-8")
    except OSError as error:
        reason = error.strerror
    except UnicodeDecodeError:
        reason = f"it is not UTF-8 text, as a {kind} file is"
    except ValueError:
        reason = "it is no path"
    else:
        return text
    raise InputError(f"The {kind} {name} cannot be read: {reason}.") from None


def parse(text: str, name: str) -> dict[str, Any]:
    """The tables of a TOML text called `name`. Raises InputError when it is none."""
    if text.startswith("\ufeff"):
        raise InputError(f"The {name} begins with a byte-order mark; save it as UTF-8 without.")
    if _longest_line(text) > MAX_LINE:
        raise InputError(
            f"The {name} has a line of over {MAX_LINE} characters beside lists of numbers; is it "
            "one?"
        )
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"The {name} is not TOML: {error}.") from None
    except RecursionError:
        raise InputError(f"The {name} is nested too deeply; is it one?") from None
    except ValueError as error:
        raise InputError(f"The {name} cannot be read as TOML: {error}.") from None


def _longest_line(text: str) -> int:
    """Characters of the longest line, on which a list of numbers counts for nothing."""
    return max(len(_NUMBERS.sub("", line)) for line in text.split("\n"))


def _split(key: str) -> list[str]:
    names = [name.strip() for name in key.split(".")]
    if not all(names) or len(names) > 4:
        raise CaseError(key, None, "this is not a key of a case file", _see_schema())
    return names


def _index(place: dict[str, Any] | list[Any], name: str, key: str, value: object) -> Any:
    """Where the name leads in a table, or the number in a list."""
    if isinstance(place, dict):
        return name
    numbers = [str(k) for k in range(len(place))]
    if name not in numbers:
        known = f"choose one of {', '.join(numbers)}" if numbers else "give the whole list"
        raise CaseError(key, value, f"the list has no item {shown(name)}", known)
    return int(name)


def _value(text: str) -> object:
    if _longest_line(text) > MAX_LINE:
        return text
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return parsed["value"] if parsed.keys() == {"value"} else text


def _see_schema(model: type[BaseModel] | None = None) -> str:
    name = get_args(model.model_fields["scene"].annotation)[0] if model else "SCENE"
    return f"'liftdrag schema {name}' lists the keys"


def _scene(tables: Mapping[str, Any]) -> Scene:
    model = _model(tables)
    try:
        return model.model_validate(dict(tables), context=_diameters(tables))
    except ValidationError as error:
        details = error.errors()
        see = _see_schema(model)
        sentences = [refusal(detail, model, see) for detail in details[:MOST_ERRORS]]
        raise _joined(sentences, len(details) - len(sentences)) from None


def _joined(errors: list[CaseError], more: int) -> InputError:
    """One error of all; a table that is none makes other keys wrong too, and is named alone."""
    tables = [error for error in errors if error.problem == NO_TABLE]
    errors = tables or errors
    if len(errors) == 1 and not more:
        return errors[0]
    others = [f"And {more} more keys are wrong."] if more else []
    return InputError("\n".join([*map(str, errors), *others]))


def _model(tables: Mapping[str, Any]) -> type[Scene]:
    name = tables.get("scene")
    if not isinstance(name, str) or name not in SCENES:
        known = ", ".join(map(repr, SCENES))
        raise CaseError("scene", name, "this names no scene", f"choose one of {known}")
    return SCENES[name]


def _diameters(tables: Mapping[str, Any]) -> dict[str, float]:
    """The diameters that other lengths are multiples of, as far as they are readable."""
    known: dict[str, float] = {}
    for symbol, table in (("d", "grains"), ("d_v", "grains"), ("D", "intruder")):
        part = tables.get(table)
        if isinstance(part, dict) and "diameter" in part:
            known[symbol] = _diameter(f"{table}.diameter", part["diameter"], known)
    return known


def _diameter(key: str, value: object, known: dict[str, float]) -> float:
    try:
        return float(TypeAdapter(Length).validate_python(value, context=known))
    except ValidationError as error:
        problem, remedy = in_words(error.errors()[0])
        raise CaseError(key, value, problem, remedy or _see_schema()) from None
