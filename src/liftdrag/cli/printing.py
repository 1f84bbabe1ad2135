"""What a command prints of what it found."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table

    from liftdrag.analysis.forces import ForceAnswers
    from liftdrag.analysis.quantity import Quantity
    from liftdrag.result import Result


def show(result: Result, as_json: bool) -> None:
    from liftdrag.terminal import budget_lines

    if as_json:
        print(json.dumps(result.record, indent=2))
        return
    for alarm in result.alarms:
        print(f"WARNING: {alarm}")
    print_table(result.quantities)
    print_lines(budget_lines(result))
    for warning in result.warnings[len(result.alarms) :]:
        print(f"WARNING: {warning}")
    print(f"In {result.folder}: {', '.join(result.files)}")


def show_forces(found: ForceAnswers, as_json: bool) -> None:
    if as_json:
        print(json.dumps(found.to_dict(), indent=2))
        return
    print_table(found.quantities)
    print(f"Averaged from {found.start_s:.6g} s to {found.end_s:.6g} s.")
    for warning in found.warnings:
        print(f"WARNING: {warning}")


def print_lines(lines: Iterable[str]) -> None:
    for line in lines:
        print(line)


def print_tables(*tables: Table) -> None:
    from rich.console import Console

    console = Console()
    wide = Console(width=None if console.is_terminal else 140)
    for table in tables:
        wide.print(table)


def print_table(quantities: Mapping[str, Quantity]) -> None:
    from rich.console import Console

    from liftdrag.terminal import table

    console = Console()
    width = console.width if console.is_terminal else 140
    Console(width=width).print(table(quantities, width))
