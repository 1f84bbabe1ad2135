"""Forces on objects buried in grains: from a short case file to averages with error bars."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from liftdrag.version import VERSION

if TYPE_CHECKING:
    from liftdrag.case import Case, load
    from liftdrag.result import Result
    from liftdrag.runner import run

__version__ = VERSION
__all__ = ["Case", "Result", "load", "run"]

_HOMES = {"Case": "liftdrag.case", "load": "liftdrag.case", "Result": "liftdrag.result"}


def __getattr__(name: str) -> Any:
    """Import the public names when they are first used, so that `--help` answers at once."""
    from importlib import import_module

    if name == "verify":
        return import_module("liftdrag.verify")
    if name not in __all__:
        raise AttributeError(f"module 'liftdrag' has no attribute {name!r}")
    return getattr(import_module(_HOMES.get(name, "liftdrag.runner")), name)
