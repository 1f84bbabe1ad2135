"""Follow a file that another program is writing."""

from __future__ import annotations

from pathlib import Path


class LogTail:
    """The lines that were added to a file since the last look."""

    def __init__(self, path: Path):
        self._path = path
        self._offset = 0
        self._rest = ""

    def lines(self) -> list[str]:
        """The complete lines written since the last call."""
        if not self._path.exists():
            return []
        with self._path.open("rb") as file:
            file.seek(self._offset)
            new = file.read()
        self._offset += len(new)
        *complete, self._rest = (self._rest + new.decode(errors="replace")).split("\n")
        return complete
