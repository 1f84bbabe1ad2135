"""The stress tensor of a shear flow as a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from liftdrag.analysis.quantity import Quantity
from liftdrag.deck.shear import COMPONENTS, PARTS


def write_tensor(tensor: Mapping[str, Quantity], file: Path) -> None:
    """A row for each component of each part of the stress: its mean and standard error."""
    import pandas as pd

    rows = [
        {"part": part, "component": name} | asdict(tensor[f"{part}_{name}"])
        for part in PARTS
        for name in COMPONENTS
    ]
    pd.DataFrame(rows).to_csv(file, index=False)
