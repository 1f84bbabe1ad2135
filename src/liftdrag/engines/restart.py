"""Where a run that was cut short goes on: its restart files, and what came after them."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import BinaryIO

from liftdrag.deck import Plan
from liftdrag.deck.restart import PHASE, STAGES, read, written
from liftdrag.engines.phases import Phase, phase_at, text_of
from liftdrag.engines.profiles import PROFILES
from liftdrag.engines.stopper import go_on, stop_files
from liftdrag.files import text

MARK = b"LammpS RestartT\0"
"""How a restart file of LAMMPS begins and, when it is whole, ends."""

_KEPT = re.compile(r"^LIFTDRAG KEPT (\S+) at step (\d+)$", re.MULTILINE)
"""What LIGGGHTS says of a restart file once it is whole."""

ANSWERED_FROM = ("surface.dump", "snapshots.dump", "fields.dump", "contacts.dump")
DUMPS = (*ANSWERED_FROM, "trajectory.dump")

_HEAD = 8
"""Lines of a frame's head below its first."""

_NTIMESTEP, _TEXTS = 5, (0, 4)
_FRAME = re.compile(rb"^ITEM: TIMESTEP\n(\d+)\n|^I[A-Z: ]*(?:\n\d*)?\Z", re.MULTILINE)
"""The head of a frame with its step, or one that was cut short without."""


@dataclass(frozen=True)
class Point:
    """A whole restart `file` of a stage, written at `step`; of a column, in a `phase`."""

    stage: str
    step: int
    file: Path
    phase: Phase | None = None


def latest(plan: Plan, folder: Path, log: str) -> Point | None:
    """The last point that a run can go on from: whole, and with all rows until there.

    `log` is the name of the engine's.
    """
    said = text_of(folder, log) if plan.fills else ""
    for stage in STAGES:
        for step, file in sorted(_whole(folder, stage, log), key=lambda found: -found[0]):
            phase = phase_at(plan, said, step) if plan.fills else None
            told = phase is not None or not plan.fills
            if told and (stage != "drive" or _reached(plan, folder, step)):
                return Point(stage, step, file, phase)
    return None


def _whole(folder: Path, stage: str, log: str) -> Iterator[tuple[int, Path]]:
    """The steps and the whole restart files of a stage; a copy is whole."""
    marks = {(name, int(step)) for name, step in _KEPT.findall(text(folder / log))}
    for name in (*written(stage), read(stage)):
        step, is_marked = step_of(folder / name)
        if step is not None and (is_marked or name == read(stage) or (name, step) in marks):
            yield step, folder / name


def step_of(file: Path) -> tuple[int | None, bool]:
    """The step of a restart file, and whether it is marked as whole.

    There is no step where the file is none, or one of LAMMPS that is cut short.
    """
    try:
        with file.open("rb") as opened:
            if opened.read(len(MARK)) != MARK:
                opened.seek(0)
                return _header_step(opened), False
            opened.seek(-len(MARK), os.SEEK_END)
            if opened.read() != MARK:
                return None, False
            opened.seek(len(MARK) + 8)
            return _header_step(opened), True
    except (OSError, ValueError, struct.error):
        return None, False


def _header_step(file: BinaryIO) -> int | None:
    """The step that the header tells, among numbers and texts, each after its flag."""
    for _ in range(_NTIMESTEP + 2):
        flag, number = struct.unpack("=ii", file.read(8))
        if flag == _NTIMESTEP:
            return int(*struct.unpack("=q", struct.pack("=i", number) + file.read(4)))
        if flag in _TEXTS:
            file.seek(number, os.SEEK_CUR)
    return None


def _reached(plan: Plan, folder: Path, step: int) -> bool:
    """Whether the series have their rows up to a step, and the dumps whole frames before it."""
    rows = all(max(_rows(folder, name), default=-1) >= step for name in _tables(plan))
    return rows and all(_is_whole(folder / name, step) for name in ANSWERED_FROM)


def _is_whole(file: Path, step: int) -> bool:
    """Whether the frames before a step hold as many lines as they say."""
    if not file.exists() or not file.stat().st_size:
        return True
    with file.open("rb") as opened, mmap(opened.fileno(), 0, access=ACCESS_READ) as content:
        frames = content[: _end(content, step)].split(b"ITEM: TIMESTEP\n")[1:]
    return all(_has_its_lines(frame) for frame in frames)


def _has_its_lines(frame: bytes) -> bool:
    lines = frame.splitlines(keepends=True)
    counted = len(lines) > _HEAD and lines[2].strip().isdigit() and lines[-1].endswith(b"\n")
    return counted and len(lines) == _HEAD + int(lines[2])


def take_back(point: Point, plan: Plan, folder: Path, log: str) -> None:
    """Leave in the folder what was there at the point; the log is kept under another name.

    It may be interrupted and done again. Raises OSError.
    """
    copy = folder / read(point.stage)
    if point.file != copy:
        _replace(copy, point.file.read_bytes())
    if point.phase is not None:
        _replace(folder / PHASE, point.phase.text().encode())
    _take_back_stops(point.phase, plan, folder)
    if point.stage == "drive":
        for name in _tables(plan):
            _keep_rows(folder, name, point.step)
        for name in DUMPS:
            _cut(folder / name, point.step)
    if (folder / log).exists():
        (folder / log).replace(_free(folder, log))


def begin_anew(plan: Plan, folder: Path) -> None:
    """Take back what was decided and kept in a run that begins anew. Raises OSError."""
    _take_back_stops(None, plan, folder)
    for name in _tables(plan):
        before(folder, name).unlink(missing_ok=True)


def _take_back_stops(phase: Phase | None, plan: Plan, folder: Path) -> None:
    """Have liftdrag decide anew whether what was not yet over at the point may end early."""
    if not plan.fills:
        go_on(folder)
    first = 1 if phase is None else phase.fill + phase.done
    for number in range(first, len(plan.fills) + 1):
        go_on(folder, stop_files(number))


def _tables(plan: Plan) -> tuple[str, ...]:
    """The files whose rows are kept: the series, and the profiles of a column."""
    return (*plan.series, PROFILES) if plan.fills else tuple(plan.series)


def join(plan: Plan, folder: Path) -> None:
    """Put the rows that were kept before those that were written since."""
    for name in _tables(plan):
        if before(folder, name).exists():
            _replace(folder / name, _text(folder, name, _rows(folder, name)))
            before(folder, name).unlink()


def before(folder: Path, name: str) -> Path:
    """The rows of a series from before the run went on."""
    return folder / f"{name}.before"


def parts(folder: Path, name: str) -> Iterator[Path]:
    """The files that the rows of a series are in, the earlier first."""
    if before(folder, name).exists():
        yield before(folder, name)
    yield folder / name


def _keep_rows(folder: Path, name: str, step: int) -> None:
    rows = {key: row for key, row in _rows(folder, name).items() if key <= step}
    _replace(before(folder, name), _text(folder, name, rows))
    (folder / name).unlink(missing_ok=True)


def _text(folder: Path, name: str, rows: dict[int, bytes]) -> bytes:
    lines = dict.fromkeys(line for line in _lines(folder, name) if line.startswith(b"#"))
    return b"".join([*lines, *(rows[key] for key in sorted(rows))])


def _rows(folder: Path, name: str) -> dict[int, bytes]:
    """The whole rows, or blocks of them, by their steps; of two with the same step the earlier.

    An engine that goes on may write a row at the step that it goes on from, of forces computed
    anew.
    """
    lines = (line for line in _lines(folder, name) if line.endswith(b"\n"))
    rows = dict[int, bytes]()
    for line in lines:
        words = line.split()
        if words[:1] and words[0].isdigit():
            more = int(words[1]) if name == PROFILES else 0
            block = [line, *islice(lines, more)]
            if len(block) == more + 1:
                rows.setdefault(int(words[0]), b"".join(block))
    return rows


def _lines(folder: Path, name: str) -> Iterator[bytes]:
    for file in parts(folder, name):
        if file.exists():
            yield from file.read_bytes().splitlines(keepends=True)


def _cut(file: Path, step: int) -> None:
    """Cut a dump before the first frame at the step or later: that one is written again."""
    if not file.exists() or not file.stat().st_size:
        return
    with file.open("r+b") as opened:
        with mmap(opened.fileno(), 0, access=ACCESS_READ) as content:
            end = _end(content, step)
        opened.truncate(end)


def _end(content: mmap, step: int) -> int:
    """Where the frames before a step end."""
    for match in _FRAME.finditer(content):
        if int(match[1] or step) >= step:
            return match.start()
    return len(content)


def _replace(file: Path, content: bytes) -> None:
    beside = file.with_name(f"{file.name}.part")
    with beside.open("wb") as opened:
        opened.write(content)
        opened.flush()
        os.fsync(opened.fileno())
    beside.replace(file)


def _free(folder: Path, name: str) -> Path:
    """A name for what a file was until now: log.lammps.1, log.lammps.2."""
    number = 1
    while (folder / f"{name}.{number}").exists():
        number += 1
    return folder / f"{name}.{number}"
