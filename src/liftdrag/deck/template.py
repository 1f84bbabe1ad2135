"""The packaged templates, filled in: a name that is missing is an error, never a blank."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

import jinja2


@cache
def environment(escaped: bool) -> jinja2.Environment:
    """The packaged templates; what fills them in is escaped for HTML, or not."""
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(template),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=escaped,
    )


def template(name: str) -> str:
    """The text of a packaged template."""
    return (resources.files("liftdrag.templates") / name).read_text("utf-8")


def render(name: str, context: Mapping[str, Any]) -> str:
    """A template filled in; a name that the context lacks raises jinja2.UndefinedError."""
    return environment(escaped=False).get_template(name).render(context)
