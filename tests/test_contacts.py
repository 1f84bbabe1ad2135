"""Summed contacts against LAMMPS' own sums and against sums by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from liftdrag import contacts
from liftdrag.contacts import read_contact_dump
from liftdrag.errors import InputError
from liftdrag.tables import column, read_table

DATA = Path(__file__).parent / "data" / "tables"
BOX = "ITEM: BOX BOUNDS pp pp ff\n0 1\n0 1\n0 1\n"


def snapshot(step: int, *rows: str, label: str = "ENTRIES", count: int | None = None) -> str:
    number = len(rows) if count is None else count
    head = (
        f"ITEM: TIMESTEP\n{step}\nITEM: NUMBER OF {label}\n{number}\n{BOX}ITEM: {label} id fx fz\n"
    )
    return head + "".join(f"{row}\n" for row in rows)


def written(folder: Path, text: str | bytes, name: str = "contacts.dump") -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def sums(path: Path, **options: float) -> list[list[float]]:
    return read_contact_dump([path], "fx", "fz", **options).to_numpy().tolist()


@pytest.mark.parametrize(
    ("dump", "columns", "thermo", "sign"),
    [
        ("wall.dump", ("f_wall[2]", "f_wall[4]"), ("v_drag", "v_lift"), -1.0),
        ("pairs.dump", ("c_pairs[1]", "c_pairs[2]"), ("c_between[1]", "c_between[2]"), 1.0),
    ],
)
def test_sums_are_those_that_lammps_itself_reduced(
    dump: str, columns: tuple[str, str], thermo: tuple[str, str], sign: float
) -> None:
    frame = read_contact_dump(DATA / dump, *columns, sign=sign, time_step=2e-5)
    log = read_table(DATA / "thermo.txt")
    assert frame["step"].tolist() == column(log, "Step").tolist()
    np.testing.assert_allclose(frame["time"], column(log, "Time"), rtol=1e-12)
    np.testing.assert_allclose(frame["drag"], column(log, thermo[0]), rtol=1e-8, atol=1e-15)
    np.testing.assert_allclose(frame["lift"], column(log, thermo[1]), rtol=1e-8, atol=1e-15)
    assert frame["contacts"].max() > 0


def test_liggghts_dump_local() -> None:
    frame = read_contact_dump([DATA / "liggghts_contacts.dump"], "c_fc[4]", "c_fc[6]")
    assert list(frame.columns) == ["step", "drag", "lift", "contacts"]
    assert frame.to_numpy().tolist() == [[0.0, 0.0, 0.0, 0.0], [500.0, 0.375, 1.25, 2.0]]


def test_sign_and_order_of_several_files(tmp_path: Path) -> None:
    late = written(tmp_path, snapshot(1000, "1 4 8"), "dump.1000")
    early = written(tmp_path, snapshot(20, "1 1 2", "2 0 -5", "3 0 0"), "dump.20")
    frame = read_contact_dump([late, early], "fx", "fz", sign=-1.0)
    assert frame.to_numpy().tolist() == [[20, -1, 3, 2], [1000, -4, -8, 1]]


def test_a_step_that_comes_again_keeps_its_last_snapshot(tmp_path: Path) -> None:
    text = snapshot(1, "1 1 1") + snapshot(2, "1 2 2") + snapshot(2, "1 3 3") + snapshot(3)
    assert sums(written(tmp_path, text)) == [[1, 1, 1, 1], [2, 3, 3, 1], [3, 0, 0, 0]]


def test_no_force_has_no_sign(tmp_path: Path) -> None:
    frame = read_contact_dump([written(tmp_path, snapshot(3))], "fx", "fz", sign=-1.0)
    assert not np.signbit(frame["drag"][0])


def test_time_and_units_sections_and_words_in_other_columns(tmp_path: Path) -> None:
    text = snapshot(4, "Si 2 3", label="ATOMS")
    text = "ITEM: UNITS\nsi\nITEM: TIME\n0.5\n" + text
    assert sums(written(tmp_path, text)) == [[4, 2, 3, 1]]


def test_blocks_do_not_change_the_sum(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    forces = np.random.default_rng(3).integers(-5, 6, (101, 2))
    rows = [f"{k} {x} {z}" for k, (x, z) in enumerate(forces)]
    monkeypatch.setattr(contacts, "ROWS_AT_ONCE", 10)
    some = sum(1 for x, z in forces if x or z)
    expected = [7, sum(x for x, _ in forces), sum(z for _, z in forces), some]
    assert sums(written(tmp_path, snapshot(7, *rows))) == [expected]


@pytest.mark.parametrize("name", ["pairs.dump", "liggghts_contacts.dump"])
@pytest.mark.parametrize("block", [1, 2, 50_000])
def test_a_dump_cut_at_any_byte_gives_its_whole_snapshots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, block: int
) -> None:
    monkeypatch.setattr(contacts, "ROWS_AT_ONCE", block)
    whole, names = (DATA / name).read_bytes()[:1200], columns_of(name)
    complete = list(contacts.snapshots(written(tmp_path, whole, "whole"), *names))
    ends = ends_of_snapshots(whole)
    assert len(complete) == len(ends)
    for size in range(len(whole)):
        path = written(tmp_path, whole[:size])
        count = sum(end <= size for end in ends)
        try:
            frame = read_contact_dump([path], *names)
        except InputError:
            assert count == 0
        else:
            assert list(frame.itertuples(index=False, name=None)) == complete[:count]


def columns_of(name: str) -> tuple[str, str]:
    return ("c_pairs[1]", "c_pairs[2]") if name == "pairs.dump" else ("c_fc[4]", "c_fc[6]")


def ends_of_snapshots(raw: bytes) -> list[int]:
    """Bytes after which a snapshot is complete, found by counting lines."""
    ends, lines, at = [], raw.splitlines(keepends=True), 0
    while at + 9 <= len(lines):
        at += 9 + int(lines[at + 3])
        if at <= len(lines) and lines[at - 1].endswith(b"\n"):
            ends.append(len(b"".join(lines[:at])))
    return ends


def test_a_cut_file_among_others_loses_only_its_cut_snapshot(tmp_path: Path) -> None:
    cut = written(tmp_path, snapshot(2, "1 1 1", count=2), "cut")
    good = written(tmp_path, snapshot(1, "1 1 1"), "good")
    frame = read_contact_dump([good, cut], "fx", "fz")
    assert frame["step"].tolist() == [1]
    with pytest.raises(InputError, match="no complete snapshot"):
        read_contact_dump([cut], "fx", "fz")


GOOD = snapshot(1, "1 1 1")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        (b"\0\1\2", "is binary"),
        ("1 2 3\n", "no `ITEM:` line"),
        (GOOD + "7 7 7\n" + GOOD, "line 11 is not the `ITEM:` line"),
        (snapshot(1, "1 1 1", "2 1", "3 1 1"), "line 11 is not a row of 3"),
        (snapshot(1, "1 1 x"), "line 10 is not a row"),
        (snapshot(1, "1 nan 1"), "finite forces"),
        (snapshot(1, "1 1 1", count=2) + GOOD, "line 11 "),
        (snapshot(1, "1 1 1", count=50) + GOOD, "line 11 cuts the snapshot above it short"),
        (GOOD.replace("OF ENTRIES\n1", "OF ENTRIES\n-1"), "line 4 is not a whole number"),
        (GOOD.replace("TIMESTEP\n1", "TIMESTEP\n" + "9" * 5000), "line 2 is not a whole number"),
        (GOOD.replace("ITEM: TIMESTEP\n1\n", ""), "line 7 comes before the time step"),
        (GOOD.replace(" fx ", " f_x "), "no column fx, did you mean f_x; take one of id, f_x, fz"),
    ],
)
def test_bad_dumps(tmp_path: Path, text: str | bytes, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_contact_dump([written(tmp_path, text)], "fx", "fz")


def test_missing_file_directory_and_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_contact_dump([tmp_path / "none"], "fx", "fz")
    with pytest.raises(InputError, match="is a directory"):
        read_contact_dump([tmp_path], "fx", "fz")
    with pytest.raises(InputError, match="no complete snapshot"):
        read_contact_dump([], "fx", "fz")
