"""Ranks that share cores: a warning."""

from __future__ import annotations

from collections.abc import Iterator

from liftdrag.cost.kind import Kind


def turns(kind: Kind) -> Iterator[str]:
    """A warning where there are more ranks than cores."""
    if kind.takes_turns:
        where = f"{kind.cores} core{'s' * (kind.cores > 1)}"
        yield f"{kind.ranks} ranks on {where} take turns: it is done sooner on {kind.cores}."
