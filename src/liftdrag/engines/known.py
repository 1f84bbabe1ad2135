"""What probes found before, so that the same engine is not asked the same again.

A file a question, in the user's cache folder. The name of the file is a digest of all that
the answer depends on: the engine's place, size and date, its version, the machine, liftdrag's
templates and the grains. What cannot be read or written is asked anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, fields
from importlib import metadata, resources
from pathlib import Path

from liftdrag.engines.base import Engine
from liftdrag.engines.probes import Probe, Subject, probe


def probed(engine: Engine, subject: Subject, names: tuple[str, ...]) -> list[Probe]:
    """The probes of these names, from memory where they passed before."""
    remembered = {name: _recall(engine, subject, name) for name in names}
    missing = tuple(name for name, found in remembered.items() if found is None)
    for found in probe(engine, subject, missing):
        remembered[found.name] = found
        if found.passed:
            _remember(engine, subject, found)
    return [found for found in remembered.values() if found is not None]


def _recall(engine: Engine, subject: Subject, name: str) -> Probe | None:
    try:
        stored = json.loads(_file(engine, subject, name).read_text("utf-8"))
        found = Probe(**{field.name: stored[field.name] for field in fields(Probe)})
        return found if found.name == name else None
    except (OSError, RuntimeError, ValueError, LookupError, TypeError):
        return None


def _remember(engine: Engine, subject: Subject, found: Probe) -> None:
    with contextlib.suppress(OSError, RuntimeError):
        file = _file(engine, subject, found.name)
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False) as beside:
            json.dump(asdict(found), beside)
        Path(beside.name).replace(file)


def _file(engine: Engine, subject: Subject, name: str) -> Path:
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path("~/.cache").expanduser())
    numbers = engine.dialect.numbers(subject.contact, 2)
    question = json.dumps([name, *_identity(engine), asdict(subject), numbers, *_templates()])
    digest = hashlib.sha256(question.encode()).hexdigest()
    return Path(cache) / "liftdrag" / "probes" / f"{digest}.json"


def _identity(engine: Engine) -> Iterator[object]:
    about = engine.about()
    state = about.path.stat()
    yield from (engine.name, about.version, str(about.path), state.st_size, state.st_mtime_ns)
    yield from (platform.node(), os.environ.get("LD_LIBRARY_PATH"), metadata.version("liftdrag"))


def _templates() -> Iterator[str]:
    root = Path(str(resources.files("liftdrag.templates")))
    for file in sorted(root.rglob("*.j2")):
        yield file.read_text("utf-8")
