"""Tables of a TOML file, written."""

from __future__ import annotations

import json
from typing import Any


def table(name: str, values: dict[str, Any]) -> str:
    """A table of numbers, texts, and lists of them."""
    lines = [f"{key} = {_shown(value)}" for key, value in values.items()]
    return "\n".join(["", f"[{name}]", *lines, ""])


def _shown(value: Any) -> str:
    return json.dumps(value) if isinstance(value, str | list) else repr(value)
