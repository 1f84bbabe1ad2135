"""Tables against the numbers that stand in the files, read by naive loops or by hand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from liftdrag.errors import InputError
from liftdrag.tables import column, ordered, read_table, times

DATA = Path(__file__).parent / "data" / "tables"
STEPS = [100.0 * k for k in range(11)]


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "table.txt"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def naive_rows(path: Path) -> list[list[float]]:
    """Every line that consists of numbers alone, between blanks or commas."""
    rows = []
    for line in path.read_text().replace(",", " ").splitlines():
        try:
            rows.append([float(word) for word in line.split()])
        except ValueError:
            continue
    return [row for row in rows if row]


def frame_of(**columns: list[float]) -> pd.DataFrame:
    return pd.DataFrame(columns)


def test_ave_time_of_lammps() -> None:
    frame = read_table(DATA / "averages.txt")
    assert list(frame.columns) == ["TimeStep", "v_drag", "v_lift"]
    assert frame.to_numpy().tolist() == naive_rows(DATA / "averages.txt")
    assert frame["v_lift"][1] == -0.323602


def test_log_of_lammps_joins_runs_and_skips_warnings() -> None:
    frame = read_table(DATA / "thermo.txt")
    assert frame["Step"].tolist() == STEPS
    assert frame["v_lift"][3] == -0.01344545773
    assert list(frame.columns[-2:]) == ["c_between[1]", "c_between[2]"]


def test_log_and_print_of_the_same_run_agree() -> None:
    log, printed = read_table(DATA / "thermo.txt"), read_table(DATA / "lines.txt")
    seconds, rows = ordered(printed)
    np.testing.assert_allclose(seconds, column(log, "Time"), rtol=1e-9)
    np.testing.assert_allclose(column(rows, "drag"), column(log, "drag"), rtol=1e-9)


def test_print_with_a_default_title_has_numbered_columns() -> None:
    frame = read_table(DATA / "plain.txt")
    assert list(frame.columns) == ["c1", "c2"]
    assert frame.to_numpy().tolist() == naive_rows(DATA / "plain.txt")


def test_default_title_never_names_columns(tmp_path: Path) -> None:
    frame = read_table(written(tmp_path, "# Fix print output for fix f\n1 2 3 4 5 6\n"))
    assert list(frame.columns) == ["c1", "c2", "c3", "c4", "c5", "c6"]


def test_print_of_liggghts_mixes_separators_and_repeats_its_title() -> None:
    frame = read_table(DATA / "liggghts_print.txt")
    assert list(frame.columns) == ["step", "time", "drag", "lift"]
    assert frame["drag"].tolist() == [0.5, 0.75, 0.75, 1.5]
    assert frame["lift"].tolist() == [-0.25, 0.0, 0.125, 1e-3]


def test_log_of_liggghts_that_crashed_keeps_its_rows() -> None:
    frame = read_table(DATA / "liggghts_log.txt")
    assert frame["Step"].tolist() == [0.0, 500.0, 1000.0]
    assert frame["v_drag"].tolist() == [0.0, 0.11, 0.13]


def test_log_keeps_only_runs_with_the_last_columns(tmp_path: Path) -> None:
    text = "Step Temp\n0 1\n5 2\nLoop time of 1\nStep v_a\n5 7\nLoop time of 1\nStep v_b\n"
    assert read_table(written(tmp_path, text)).to_numpy().tolist() == [[5.0, 7.0]]


def test_text_after_a_run_is_not_data(tmp_path: Path) -> None:
    text = "Step v_a\n0 1\nLoop time of 1 on 1 procs\n7 8\n9 nonsense 3\n"
    assert read_table(written(tmp_path, text)).to_numpy().tolist() == [[0.0, 1.0]]


def test_csv(tmp_path: Path) -> None:
    text = '\ufeff"time (s)", "drag, N",lift\r\n0,1.5,-1\r\n0.5,2.5,\r\n'
    frame = read_table(written(tmp_path, text))
    assert list(frame.columns) == ["time (s)", "drag, N", "lift"]
    assert frame["drag, N"].tolist() == [1.5, 2.5]
    assert np.isnan(frame["lift"][1])
    assert times(frame).tolist() == [0.0, 0.5]


def test_csv_that_pandas_wrote(tmp_path: Path) -> None:
    frame_of(time=[0.0, 1.0], drag=[2.0, 3.0]).to_csv(tmp_path / "out.csv")
    frame = read_table(tmp_path / "out.csv")
    assert times(frame).tolist() == [0.0, 1.0]
    assert column(frame, "drag").tolist() == [2.0, 3.0]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("Step v_a\n1 2\n", ["Step", "v_a"]),
        ("# TimeStep v_a\n1 2\n", ["TimeStep", "v_a"]),
        ("Step, a\n1, 2\n", ["Step", "a"]),
        ("Step number,a\n1,2\n", ["Step number", "a"]),
        ("1,2\n", ["c1", "c2"]),
        ("# run 7\n# x y\n1\t2\n", ["x", "y"]),
        ("# one two three\n1 2\n", ["c1", "c2"]),
        ("x y\n1 2\nx y\n", ["x", "y"]),
    ],
)
def test_auto_names_the_columns(tmp_path: Path, text: str, names: list[str]) -> None:
    frame = read_table(written(tmp_path, text))
    assert list(frame.columns) == names
    assert frame.to_numpy().tolist() == [[1.0, 2.0]]


@pytest.mark.parametrize("form", ["ave-time", "print"])
def test_header_repeated_by_a_restart(tmp_path: Path, form: str) -> None:
    header = "# Time-averaged data for fix av\n# TimeStep v_drag\n"
    path = written(tmp_path, f"{header}10 1\n20 2\n{header}20 3\n30 4\n")
    frame = read_table(path, form)
    assert frame["v_drag"].tolist() == [1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize("name", ["averages.txt", "lines.txt", "thermo.txt", "liggghts_print.txt"])
@pytest.mark.parametrize("form", ["auto", "ave-time", "thermo", "print", "csv"])
def test_a_file_cut_at_any_byte_gives_whole_rows_or_a_clear_error(
    tmp_path: Path, name: str, form: str
) -> None:
    whole = (DATA / name).read_bytes()
    known = {tuple(row) for row in naive_rows(DATA / name)}
    step = 1 if len(whole) < 1000 else 7
    for size in range(0, len(whole), step):
        try:
            frame = read_table(written(tmp_path, whole[:size]), form)
        except InputError:
            continue
        assert {tuple(row) for row in frame.to_numpy()} <= known


def test_a_cut_ave_time_file_loses_only_the_row_that_is_cut(tmp_path: Path) -> None:
    whole = (DATA / "averages.txt").read_bytes()
    rows = naive_rows(DATA / "averages.txt")
    for size in range(whole.index(b"\n100") + 1, len(whole)):
        complete = whole[:size].count(b"\n") - 2
        path = written(tmp_path, whole[:size])
        if complete < 1:
            with pytest.raises(InputError, match="no rows of numbers"):
                read_table(path)
        else:
            assert read_table(path, "ave-time").to_numpy().tolist() == rows[:complete]


@pytest.mark.parametrize("last", ["30", "30 3x", "30 3 slurmstepd: error", "Killed"])
def test_a_damaged_last_row_is_dropped(tmp_path: Path, last: str) -> None:
    frame = read_table(written(tmp_path, f"# TimeStep v_a\n10 1\n20 2\n{last}\n"))
    assert frame.to_numpy().tolist() == [[10.0, 1.0], [20.0, 2.0]]


@pytest.mark.parametrize("bad", ["20", "20 x", "20 2 3", "20 2_5", "20 2# TimeStep v_a"])
@pytest.mark.parametrize("header", ["# TimeStep v_a", "Step v_a", "# x y"])
def test_a_bad_row_in_the_middle_names_its_line(tmp_path: Path, bad: str, header: str) -> None:
    path = written(tmp_path, f"{header}\n10 1\n\n{bad}\n30 3\n")
    with pytest.raises(InputError, match=f"{re.escape(str(path))}: line 4 "):
        read_table(path)


def test_a_damaged_first_row_is_no_header(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 1 "):
        read_table(written(tmp_path, "10 x\n20 2\n30 3\n"))


def test_too_many_numbers_in_the_last_row_are_no_crash(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 3 "):
        read_table(written(tmp_path, "# TimeStep v_a\n10 1\n20 2 3\n"))


@pytest.mark.parametrize(
    ("content", "form", "words"),
    [
        (b"", "auto", "is empty"),
        (b"\n \n", "auto", "no rows of numbers"),
        (b"\x7fELF\0\1\2", "auto", "is binary"),
        (b"\xff\xfe\xfd words\n", "auto", "no rows of numbers"),
        (b"# TimeStep v_a\n", "auto", "no rows of numbers"),
        (b"Step v_a\nLoop time of 1\n", "auto", "no rows of numbers"),
        (b"1 2\n", "thermo", "no rows of numbers"),
        (b"1 2\n", "ave-time", "no header"),
        (b"1 2\n", "excel", "take one of auto, ave-time"),
        (b"# TimeStep Number-of-rows\n# Row v_a\n10 2\n1 5\n2 6\n", "auto", "vectors"),
        (b"# TimeStep v_a\n1 2\n# TimeStep v_b\n2 3\n", "auto", "line 3 names other columns"),
        (b"a,b\r1,2\nc,d\n", "csv", "no rows of numbers|not a row|no CSV"),
    ],
)
def test_bad_files(tmp_path: Path, content: bytes, form: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_table(written(tmp_path, content), form)


def test_missing_file_and_directory(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_table(tmp_path / "none.txt")
    with pytest.raises(InputError, match="is a directory"):
        read_table(tmp_path)


@pytest.mark.parametrize("name", ["v_drag", "drag", "2"])
def test_column_by_name_or_number(name: str) -> None:
    frame = frame_of(TimeStep=[1.0, 2.0], v_drag=[3.0, 4.0], v_lift=[5.0, 6.0])
    assert column(frame, name).tolist() == [3.0, 4.0]


def test_column_given_with_a_prefix_that_the_table_lacks() -> None:
    assert column(frame_of(drag=[1.0]), "v_drag").tolist() == [1.0]


def test_exact_names_come_before_prefixes_and_numbers() -> None:
    frame = pd.DataFrame([[1.0, 2.0, 3.0]], columns=["v_drag", "drag", "1"])
    assert column(frame, "drag").tolist() == [2.0]
    assert column(frame, "1").tolist() == [3.0]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("darg", "no column darg, did you mean v_drag; take one of 1 Step, 2 v_drag, 3 c_drag"),
        ("0", "no column 0; take"),
        ("6", "no column 6; take"),
        ("c_lift", "no column c_lift"),
        ("drag", "drag is ambiguous"),
        ("same", "same is ambiguous"),
    ],
)
def test_columns_that_are_not_there_or_not_one(name: str, words: str) -> None:
    names = ["Step", "v_drag", "c_drag", "same", "same"]
    frame = pd.DataFrame([[0.0] * 5], columns=names)
    with pytest.raises(InputError, match=words):
        column(frame, name)


def test_a_column_that_is_not_finite() -> None:
    with pytest.raises(InputError, match=r"1 of 2 values .* row 2"):
        column(frame_of(drag=[1.0, np.nan]), "drag")


def test_times() -> None:
    frame = frame_of(Step=[0.0, 10.0], Time=[0.0, 3.0])
    assert times(frame).tolist() == [0.0, 3.0]
    assert times(frame, "Step", 0.5).tolist() == [0.0, 5.0]
    assert times(frame, "1", 0.5).tolist() == [0.0, 5.0]
    assert times(frame_of(TimeStep=[2.0]), time_step=0.25).tolist() == [0.5]
    assert times(frame_of(v_time=[2.0], v_drag=[1.0])).tolist() == [2.0]


@pytest.mark.parametrize("time_step", [None, 0.0, -1.0, np.nan, np.inf])
def test_steps_need_a_time_step(time_step: float | None) -> None:
    with pytest.raises(InputError, match="--time-step"):
        times(frame_of(TimeStep=[1.0]), time_step=time_step)


def test_a_table_without_times() -> None:
    with pytest.raises(InputError, match="--time-column: 1 drag, 2 lift"):
        times(frame_of(drag=[1.0], lift=[1.0]))


def naive_ordered(steps: list[float]) -> list[int]:
    """Row numbers left when each row first deletes those at its own or a later time."""
    kept: list[int] = []
    for row, step in enumerate(steps):
        kept = [old for old in kept if steps[old] < step] + [row]
    return kept


@pytest.mark.parametrize(
    "steps",
    [
        [0, 1, 2, 3],
        [0, 1, 2, 2, 3],
        [0, 2, 4, 6, 3, 5, 7],
        [5, 6, 0, 1],
        [3, 2, 1],
        [1],
        np.random.default_rng(1).integers(0, 50, 200).tolist(),
    ],
)
def test_ordered_keeps_what_was_written_last(steps: list[float]) -> None:
    frame = frame_of(step=[float(s) for s in steps], row=[float(k) for k in range(len(steps))])
    seconds, rows = ordered(frame, time_step=0.5)
    assert rows["row"].tolist() == naive_ordered(steps)
    assert seconds.tolist() == [0.5 * steps[k] for k in naive_ordered(steps)]
    assert list(rows.index) == list(range(len(rows)))
