"""Damaged files: refused, or answered as the whole ones; no number is ever read short."""

from __future__ import annotations

import contextlib
import json
import math
import shutil
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import tiny_tank
from hypothesis import given, settings
from hypothesis import strategies as st

from liftdrag import arrays, beds, replicas, runner
from liftdrag.arrays import read_arrays
from liftdrag.deck.tank import Bed
from liftdrag.engines.checks import LOOP
from liftdrag.engines.family import read_dump
from liftdrag.engines.log import LogTail
from liftdrag.engines.profiles import SUMS, read_profiles
from liftdrag.engines.samples import read_samples
from liftdrag.ensemble import PACKINGS, each_of
from liftdrag.errors import InputError
from liftdrag.files import whole_lines
from liftdrag.folder import RECORD, RESULT, Record, read_json
from liftdrag.pictures import tank as pictures
from liftdrag.result import Result
from liftdrag.tables import read_table

HEAD = "ITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp pp ff\n0 1\n0 1\n0 1\n"
DUMP = "".join(
    HEAD.format(step) + f"ITEM: ATOMS id x y\n1 1.234 0.5{step}\n2 2.5 -1.75e-05\n"
    for step in (0, 10, 20)
)
AVE = "# Time-averaged data for fix forces\n# TimeStep v_drag v_lift\n" + "".join(
    f"{10 * k} 1.23{k} -4.5{k}e-03\n" for k in range(1, 5)
)
PROFILE = (
    f"# Chunk-averaged data\n# Timestep Number-of-chunks\n# Chunk Coord1 Ncount "
    f"{' '.join(SUMS.values())}\n"
) + "".join(
    f"{step} 2\n" + "".join(f"  {k} 0.00{k} 1{k} 1.5 2 3 4 5 6 7.25\n" for k in (1, 2))
    for step in (100, 200, 300)
)
SAMPLES = "time,drag\n" + "".join(f"{0.5 * k},1.23{k}\n" for k in range(1, 5))
LOG = "".join(f"LIFTDRAG STAGE drive {k}00\nLoop time of 1.5 on 1 procs\n" for k in range(1, 4))


def dumped(path: Path) -> list[Any]:
    return [[step, *rows.ravel()] for step, rows in read_dump(path)]


def profiled(path: Path) -> list[Any]:
    return [[one.time, *one.height, *one.count, *one.spin] for one in read_profiles(path, 0.1)]


def tabled(path: Path) -> list[Any]:
    return [list(row) for row in read_table(path, "ave-time").itertuples(index=False)]


def sampled(path: Path) -> list[Any]:
    series = read_samples(path, {"drag": "N"})
    return list(zip(series.time, series["drag"], strict=True))


def tailed(path: Path) -> list[Any]:
    return LogTail(path).lines()


READERS = {
    "dump": (dumped, DUMP, 3),
    "ave/time": (tabled, AVE, 4),
    "profile": (profiled, PROFILE, 3),
    "samples": (sampled, SAMPLES, 4),
    "log": (tailed, LOG, 6),
}
TABLES = [name for name in READERS if name != "log"]


@pytest.fixture(params=READERS)
def reader(
    request: pytest.FixtureRequest, tmp_path: Path
) -> tuple[Callable[[str], list[Any] | None], str, int]:
    """What a reader makes of a text, None where it refuses it; its file, and its whole rows."""
    read, text, count = READERS[request.param]

    def read_text(content: str) -> list[Any] | None:
        (tmp_path / "x").write_bytes(content.encode())
        try:
            return read(tmp_path / "x")
        except (InputError, ValueError):
            return None

    return read_text, text, count


def test_file_cut_at_any_byte_gives_whole_rows_or_none(reader):
    """So no number is ever read short: 1.234 as 1.2."""
    read, text, count = reader
    whole = read(text)
    assert len(whole) == count
    for end in range(len(text)):
        found = read(text[:end]) or []
        assert found == whole[: len(found)]
    assert len(read(text[:-1]) or []) == count - 1


def damaged(text: str, rng: Any) -> str:
    lines = text.split("\n")
    one, other = sorted(rng.sample(range(len(lines) - 1), 2))
    way = rng.choice(["twice", "swap", "again", "drop", "word", "join"])
    if way == "twice":
        return text + text
    if way == "swap":
        lines[one], lines[other] = lines[other], lines[one]
    elif way == "again":
        lines.insert(other, lines[one])
    elif way == "drop":
        del lines[one]
    elif way == "join":
        lines[one : one + 2] = [" ".join(lines[one : one + 2])]
    else:
        words = lines[one].split(" ")
        words[rng.randrange(len(words))] = rng.choice(["nan", "inf", "1.0+300", "1e999", "x", ""])
        lines[one] = " ".join(words)
    return "\n".join(lines)


@given(st.randoms(use_true_random=False), st.sampled_from(TABLES))
@settings(max_examples=300, deadline=None)
def test_damaged_file_is_refused_or_gives_its_own_numbers(tmp_path_factory, rng, name):
    read, text, _ = READERS[name]
    path = tmp_path_factory.mktemp("damaged") / "x"
    path.write_text(text)
    whole = read(path)
    path.write_text(damaged(text, rng))
    try:
        found = read(path)
    except (InputError, ValueError):
        return
    own = {number for row in whole for number in row}
    new = {number for row in found for number in row} - own
    assert not new or (name == "ave/time" and not np.isfinite(list(new)).any())


def test_nothing_is_read_after_a_line_that_is_being_written():
    """Its rest comes as a line of its own, when the file has grown meanwhile."""
    assert list(whole_lines(iter(["1 2.5\n", "2 1.2", "34 5\n"]))) == ["1 2.5\n"]


@pytest.mark.parametrize("name", TABLES)
def test_lines_that_end_as_on_windows_are_read_the_same(name: str, tmp_path: Path):
    read, text, _ = READERS[name]
    (tmp_path / "x").write_text(text)
    whole = read(tmp_path / "x")
    (tmp_path / "x").write_bytes(text.replace("\n", "\r\n").encode())
    assert read(tmp_path / "x") == whole


@pytest.mark.parametrize("count", ["-1", "10000000000000000", "9" * 5000, "1e3", "nan"])
def test_dump_of_an_impossible_count_is_refused_or_without_a_frame(count: str, tmp_path: Path):
    text = DUMP.replace("ATOMS\n2\n", f"ATOMS\n{count}\n", 1)
    (tmp_path / "x").write_text(text)
    try:
        assert dumped(tmp_path / "x") == []
    except ValueError:
        return
    assert count.startswith("1000")


def test_times_of_loops_are_numbers():
    log = "Loop time of {} on 1 procs for 5 steps with 6 atoms"
    assert [LOOP.search(log.format(time)) is not None for time in ("1.5e-05", "2")] == [True, True]
    assert LOOP.search(log.format("1.2.3")) is None
    assert LOOP.search(log.format("x")) is None


@pytest.mark.parametrize(
    "text", ["", "[]", "null", "[" * 100_000, '{"a": ' * 100_000, "\udcff", "{", '{"a": 1}x', "\0"]
)
def test_damaged_json_is_one_sentence(text: str, tmp_path: Path):
    (tmp_path / RESULT).write_text(text, "utf-8", "surrogateescape")
    with pytest.raises(InputError, match=r"result\.json is damaged; run the case again\.$"):
        read_json(tmp_path / RESULT)


@given(st.integers(0, 10_000), st.integers(0, 7), st.booleans())
@settings(max_examples=200, deadline=None)
def test_arrays_with_a_bit_changed_or_cut_are_refused_or_the_same(tmp_path_factory, at, bit, cut):
    path = tmp_path_factory.mktemp("arrays") / "x.npz"
    np.savez(path, allow_pickle=False, a=np.arange(5.0), b=np.eye(2))
    whole = bytearray(path.read_bytes())
    at %= len(whole)
    whole[at] ^= 1 << bit
    path.write_bytes(whole[:at] if cut else whole)
    with contextlib.suppress(ValueError, OSError):
        found = read_arrays(path)
        kept = {name: values.ravel().tolist() for name, values in found.items()}
        own = {"a": [0, 1, 2, 3, 4], "b": [1, 0, 0, 1]}
        assert all(values == own.get(name, values) for name, values in kept.items())


def test_arrays_that_would_fill_the_memory_are_refused(tmp_path: Path):
    np.savez_compressed(tmp_path / "x.npz", a=np.zeros(1000))
    assert read_arrays(tmp_path / "x.npz")["a"].size == 1000
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays, "MOST_BYTES", 1000)
        with pytest.raises(ValueError, match="unpacks to more than 1000 bytes"):
            read_arrays(tmp_path / "x.npz")


@pytest.mark.parametrize(
    "text", ["{}", '{"case": "x", "tables": [1]}', '{"case": 1, "tables": {}}']
)
def test_damaged_record_of_replicas_is_refused(text: str, tmp_path: Path):
    (tmp_path / replicas.CASE).write_text(text)
    with pytest.raises(InputError, match=r"replicas\.json is damaged"):
        replicas.analyze(tmp_path)


def test_replicas_that_never_began_are_refused(tmp_path: Path):
    record = {"case": "tiny", "tables": dict(tiny_tank().tables)}
    (tmp_path / replicas.CASE).write_text(json.dumps(record))
    with pytest.raises(InputError, match="no replica that has begun"):
        replicas.analyze(tmp_path)


def test_number_cut_short_in_a_table_of_packings_is_not_read(tmp_path: Path):
    (tmp_path / PACKINGS).write_text("packing,drag (N)\n1,1.234\n2,1.2")
    assert each_of(tmp_path, "drag", "N").tolist() == [1.234]
    (tmp_path / PACKINGS).write_text("packing,drag (N)\n1,nan\n")
    with pytest.raises(InputError, match="not finite"):
        each_of(tmp_path, "drag", "N")


def test_bed_that_was_kept_is_whole_or_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("LIFTDRAG_BEDS", str(tmp_path))
    beds._write("key", Bed(np.arange(6.0).reshape(2, 3), np.array([1, 2])))
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    assert beds._read("key") is not None
    for end, byte in product(range(0, len(whole), 7), (b"", b"\0", whole[:-1])):
        file.write_bytes(whole[:end] + byte)
        with pytest.raises(beds.Damaged):
            beds._read("key")


@pytest.fixture
def folder(
    result_of: Callable[[str], Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A copy of a tiny run, whose pictures are not drawn, without its seal."""
    copy = shutil.copytree(result_of("free surface").folder, tmp_path / "run")
    monkeypatch.setattr(pictures, "draw_forces", lambda *_: None)
    monkeypatch.setattr(pictures, "draw_bed", lambda *_: None)
    unsealed = read_json(copy / RESULT)
    del unsealed["sealed"]
    (copy / RESULT).write_text(json.dumps(unsealed))
    return copy


def means(folder: Path) -> dict[str, float]:
    return {name: one.mean for name, one in runner.analyze(folder).quantities.items()}


def test_run_cut_doubled_or_swapped_is_refused_or_answers_the_same(folder: Path):
    right, rng = means(folder), np.random.default_rng(1)
    for name in ("forces.dat", "bed.dat", "surface.dump"):
        whole = (folder / name).read_text()
        lines = whole.splitlines(keepends=True)
        here = [int(k) for k in rng.integers(12, len(lines) - 1, 3)]
        cuts = [whole[: int(k)] for k in rng.integers(0, len(whole), 4)]
        cuts += [whole[:-1], whole[:-3], whole + whole, "", "".join(reversed(lines))]
        cuts += ["".join(lines[:k] + lines[k + 1 :]) for k in here]
        cuts += ["".join(lines[: k + 1] + lines[k:]) for k in here]
        cuts += ["".join([*lines[:k], "nan\n", *lines[k + 1 :]]) for k in here]
        for text in cuts:
            (folder / name).write_text(text)
            with pytest.raises(InputError) as caught:
                means(folder)
            assert "\n" not in str(caught.value)
        (folder / name).write_bytes(whole.replace("\n", "\r\n").encode())
        assert means(folder) == right
        (folder / name).write_text(whole)
    assert means(folder) == right


WRONG = [None, [], {}, "x", -1, math.nan, 10**30, "\ud800\n"]


def places(record: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    for key, value in record.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from places(value, (*path, key))


def test_record_of_other_types_is_refused_or_answers_the_same(folder: Path):
    right, whole = means(folder), read_json(folder / RECORD)
    for n, place in enumerate(places({key: whole[key] for key in ("case", "tables", "plan")})):
        for value in (WRONG[n % len(WRONG)], WRONG[(n + 3) % len(WRONG)]):
            record = json.loads(json.dumps(whole))
            part = record
            for key in place[:-1]:
                part = part[key]
            part[place[-1]] = value
            (folder / RECORD).write_text(json.dumps(record))
            with contextlib.suppress(InputError):
                assert means(folder) == right or place[0] == "tables"


@pytest.mark.parametrize("name", ["/etc/passwd", "../../x.dat", "a/b.dat", "x.gz"])
def test_record_that_names_files_elsewhere_is_refused(name: str, folder: Path):
    record = read_json(folder / RECORD)
    record["plan"]["series"][name] = {"drag": "N"}
    (folder / RECORD).write_text(json.dumps(record))
    with pytest.raises(InputError, match="is damaged"):
        Record.read(folder)


@pytest.mark.parametrize("name", [RECORD, RESULT, "forces.dat", "surface.dump", "snapshots.dump"])
def test_run_whose_file_is_a_device_is_refused(name: str, folder: Path):
    (folder / name).unlink()
    (folder / name).symlink_to("/dev/zero")
    with pytest.raises(InputError):
        runner.analyze(folder)
