"""The table `[numerics]` of what a bench recommends, to be pasted into the case."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from liftdrag.bench.recommendation import Advice


def block(title: str, advice: Sequence[Advice], given: Mapping[str, Any]) -> str:
    """The table `[numerics]` of what is recommended, its reasons as comments: TOML.

    `given` is the case's own table, what is not recommended otherwise stays.
    """
    chosen = {
        one.axis.key.removeprefix("numerics."): one
        for one in advice
        if one.axis.key.startswith("numerics.")
    }
    lines = [f"# {title}", "[numerics]"]
    for key, value in given.items():
        if key not in chosen:
            lines.append(f"{key} = {_toml(value)}  # as the case has it")
    for key, one in chosen.items():
        lines += _numerics_lines(key, one, given, _longer_step(advice))
    others = [one for one in advice if not one.axis.key.startswith("numerics.")]
    if others:
        lines += ["", "# No keys of [numerics]:"]
        for one in others:
            lines += _other_lines(one)
    return "\n".join([*lines, ""])


def _numerics_lines(
    key: str, one: Advice, given: Mapping[str, Any], longer: float
) -> Iterator[str]:
    yield from _against(one)
    if one.setting is None:
        own = f"{key} = {_toml(given[key])}  # " if key in given else f"# {key}: "
        yield f"{own}{_shown(one.axis.own)} stays: {one.evidence}"
        return
    value, said = one.setting.changes[one.axis.key], f"{one.setting.name} {one.axis.of}".strip()
    if key == "sample_every" and longer != 1.0:
        value = max(round(value / longer), 1)
        said = f"{said} at the case's own time step, the same time at the one above"
    yield f"{key} = {_toml(value)}  # {said}: {one.evidence}"


def _longer_step(advice: Sequence[Advice]) -> float:
    """The recommended time step over the case's own."""
    for one in advice:
        if one.axis.name == "time_step" and one.setting is not None:
            return float(one.setting.at) / float(one.axis.own)
    return 1.0


def _other_lines(one: Advice) -> Iterator[str]:
    yield from _against(one)
    if one.setting is None:
        yield f"# {one.axis.name}: {one.axis.key} = {_shown(one.axis.own)} stays: {one.evidence}"
        return
    value = _shown(one.setting.changes.get(one.axis.key, one.setting.ranks))
    yield f"# {one.axis.name} {one.setting.name}: {one.axis.key} = {value}: {one.evidence}"


def _against(one: Advice) -> Iterator[str]:
    for words in one.cheaper:
        yield f"# not {one.axis.name} {words}"


def _shown(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _toml(value: object) -> str:
    """A number, text, or truth value as TOML."""
    return json.dumps(value)
