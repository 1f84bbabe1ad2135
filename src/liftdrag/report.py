"""The answers as a table for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from liftdrag.analysis.quantity import Quantity, rounded

if TYPE_CHECKING:
    from rich.table import Table

NARROW = 110
"""Width of a terminal in characters below which the meanings are left out."""

_MEANINGS = {
    "drag": "force along the flow",
    "lift": "force against gravity",
    "drag_coefficient": "drag / (rho g h~ D L)",
    "lift_coefficient": "lift / (rho g pi D^2/4 L)",
    "drag_coefficient_overburden": "drag / (measured overburden x D L)",
    "solid_fraction": "of the far bed",
    "depth": "of the axis below the far surface",
    "effective_depth": "h~, depth and lid",
    "overburden": "weight above the axis per area, far",
    "bed_speed_ratio": "far bed over drive",
    "inertial_number": "(U0/D) d / sqrt(P/rho_g)",
}


def table(quantities: Mapping[str, Quantity], width: int) -> Table:
    """The quantities as a table for a terminal `width` characters wide."""
    from rich.table import Table

    wide = width >= NARROW
    result = Table()
    for heading in ("quantity", "mean", "standard error", "unit", "independent samples"):
        result.add_column(heading, overflow="fold")
    if wide:
        result.add_column("meaning")
    for name, quantity in quantities.items():
        result.add_row(name, *_cells(quantity), *([_MEANINGS.get(name, "")] if wide else []))
    return result


def _cells(quantity: Quantity) -> Iterator[str]:
    mean, error = rounded(quantity.mean, quantity.standard_error)
    share = abs(quantity.standard_error / quantity.mean) if quantity.mean else float("inf")
    yield mean
    yield f"{error} ({100 * share:.2g} %)" if share < 10 else error
    yield "" if quantity.unit == "1" else quantity.unit
    count = quantity.n_independent
    mark = "" if quantity.converged else " (not converged)"
    yield ("" if count is None else f"{count:.0f}") + mark
