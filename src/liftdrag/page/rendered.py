"""The template filled in, with everything that comes from a user escaped."""

from __future__ import annotations

from collections.abc import Sequence

from liftdrag.deck.template import environment
from liftdrag.page.shown import Shown
from liftdrag.version import VERSION


def rendered(sections: Sequence[Shown]) -> str:
    """The page of these sections."""
    one = sections[0].title if len(sections) == 1 else f"{len(sections)} runs"
    return (
        environment(escaped=True)
        .get_template("report.html.j2")
        .render(
            sections=sections,
            title=f"liftdrag: {one}",
            leading=list(dict.fromkeys(name for one in sections for name in one.leading)),
            version=VERSION,
        )
    )
