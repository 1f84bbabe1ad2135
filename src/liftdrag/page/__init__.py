"""One page of HTML that shows runs and studies from what their folders hold, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from liftdrag.errors import InputError, escaped
from liftdrag.folder import put
from liftdrag.page.rendered import rendered
from liftdrag.page.shown import shown_all

__all__ = ["report"]

ENDINGS = (".html", ".htm")


def report(folders: Sequence[Path], out: Path | None = None) -> Path:
    """Write the page of these folders of runs, replicas and studies, and return where it is.

    By default `report.html` in the folder, or in the working folder for several. Raises
    InputError where a folder holds no run, or the page cannot be written there.
    """
    place = _place(folders, out)
    page = rendered(shown_all(folders))
    try:
        put(place, page)
    except OSError as error:
        raise InputError(
            f"--out {escaped(str(place))} cannot be written: {error.strerror}."
        ) from None
    return place


def _place(folders: Sequence[Path], out: Path | None) -> Path:
    """Where the page goes. Raises InputError for what is no name of a page."""
    if out is None:
        return (folders[0] if len(folders) == 1 else Path()) / "report.html"
    if out.suffix.lower() not in ENDINGS:
        raise InputError(
            f"--out {escaped(str(out))} is no page of HTML; give it a name that ends in .html."
        )
    return out
