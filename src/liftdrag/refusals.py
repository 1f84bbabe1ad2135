"""What is wrong with a file that was read, as errors that name the key, its value and a remedy."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Sequence
from typing import Any, get_args, get_origin

from pydantic import AfterValidator, BaseModel
from pydantic_core import ErrorDetails

from liftdrag.errors import CaseError

NO_TABLE = "this should be a table of keys"


def refusal(detail: ErrorDetails, model: type[BaseModel], see: str) -> CaseError:
    """What is wrong at a key of a file of this model; `see` is said where no remedy is known."""
    error = detail.get("ctx", {}).get("error")
    if isinstance(error, CaseError):
        return error
    path = [str(name) for name in detail["loc"] if name != "[key]"]
    key = ".".join(path)
    if detail["type"] == "extra_forbidden":
        return CaseError(key, None, "this key is unknown", _did_you_mean(path, model) or see)
    if detail["type"] == "missing":
        remedy = "add it: nothing that the answer depends on is guessed"
        return CaseError(key, None, "this key is missing", remedy)
    if detail["type"] in ("model_type", "dict_type"):
        return CaseError(key, detail["input"], NO_TABLE, see)
    problem, remedy = in_words(detail)
    return CaseError(key, detail["input"], problem, remedy or see)


def in_words(detail: ErrorDetails) -> tuple[str, str]:
    """What is wrong with a value, and what to do about it where that is known."""
    context = detail.get("ctx", {})
    if detail["type"] == "too_short":
        return "this list has too few items", f"give at least {context['min_length']}"
    if detail["type"] == "too_long":
        return "this list has too many items", f"give at most {context['max_length']}"
    error = context.get("error")
    text = str(error) if error else detail["msg"].replace("Input should be", "this should be")
    problem, _, remedy = text.partition("; ")
    return problem, remedy


def written_as(pattern: str, example: str) -> AfterValidator:
    """Refuses a text that is not of this pattern, with the example."""

    def check(text: str) -> str:
        if not re.fullmatch(pattern, text, re.ASCII):
            raise ValueError(f"this is not understood here; write it {example}")
        return text

    return AfterValidator(check)


def _did_you_mean(path: Sequence[str], model: type[BaseModel]) -> str:
    """The key of the same table that is like it, the same one of another, or what there is."""
    *table, last = path
    own = [name for found in _tables(model, table) for name in found.model_fields]
    if close := difflib.get_close_matches(last, own, n=1):
        return f"did you mean {'.'.join([*table, close[0]])}"
    known = [key for key in keys(model) if not table or key.rpartition(".")[2] == last]
    if close := difflib.get_close_matches(".".join(path), known, n=1, cutoff=0.5):
        return f"did you mean {close[0]}"
    return f"choose one of {', '.join(own)}" if table and own else ""


def _tables(kind: Any, path: Sequence[str]) -> Iterator[type[BaseModel]]:
    """The tables that may be at a path below a type."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if not path:
            yield kind
        elif path[0] in kind.model_fields:
            yield from _tables(kind.model_fields[path[0]].annotation, path[1:])
    elif get_origin(kind) in (list, dict):
        if path:
            yield from _tables(get_args(kind)[-1], path[1:])
    else:
        for other in get_args(kind):
            yield from _tables(other, path)


def keys(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Every dotted key of a file of this model."""
    for name, field in model.model_fields.items():
        yield prefix + name
        for kind in (field.annotation, *get_args(field.annotation)):
            if isinstance(kind, type) and issubclass(kind, BaseModel):
                yield from keys(kind, f"{prefix}{name}.")
