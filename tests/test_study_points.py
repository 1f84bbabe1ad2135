"""The points of a study: which cases, called what, how often; and what their runs say together."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import product
from math import exp, log, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import TINY
from matplotlib.axes import Axes as Panel
from matplotlib.figure import Figure
from rich.console import Console

from liftdrag.analysis.quantity import Quantity
from liftdrag.errors import InputError
from liftdrag.page.study import study_sheets
from liftdrag.pictures import study as pictures
from liftdrag.pictures.study import Line
from liftdrag.study import read
from liftdrag.study.carried import answer
from liftdrag.study.drawn import _curve, draw
from liftdrag.study.findings import findings, growths
from liftdrag.study.points import Point, points_of
from liftdrag.study.state import State
from liftdrag.study.studied import Studied
from liftdrag.study.tables import _write, write_tables
from liftdrag.study.tasks import Task, distinct, tasks_of
from liftdrag.terminal import growth_lines, run_table

STUDY = """
title = "Depth"
replicas = 2
[set]
"drive.speed" = "0.1 m/s"
[grid]
"intruder.depth" = ["3 D", "4 D"]
[runs.plain]
case = "{case}"
[runs.rough]
case = "{case}"
set = {{ "grains.friction" = 0.9, "drive.distance" = "8 D" }}
grid = {{ "intruder.diameter" = ["1.5 d", "1.75 d", "2 d"] }}
replicas = 1
[scales.small]
set = {{ "drive.distance" = "5 D" }}
[scales.large]
set = {{ "drive.distance" = "20 D" }}
grid = {{ "intruder.depth" = ["2 D", "3 D", "4 D"] }}
replicas = 3
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    (tmp_path / "tiny.toml").write_text(TINY)
    file = tmp_path / "depth.study"
    file.write_text(STUDY.format(case=tmp_path / "tiny.toml"))
    return file


def points(study: Path, scale: str | None = None, *settings: str) -> dict[str, Point]:
    return points_of(read(str(study)), scale, settings)


def test_points_are_all_combinations(study: Path):
    """By a naive loop; a run's own keys go before those of all, a scale's before both."""
    found = points(study)
    expected = {("plain", depth * 1.5, 1.5) for depth in (3, 4)}
    expected |= {("rough", depth * big, big) for depth, big in product((3, 4), (1.5, 1.75, 2))}
    d = 1.5e-3
    given = {
        (one.run, *(round(one.number(f"intruder.{key}") / d, 6) for key in ("depth", "diameter")))
        for one in found.values()
    }
    assert given == expected
    assert all(
        one.number("drive.distance") == pytest.approx(5 * one.number("intruder.diameter"))
        for one in found.values()
    )
    assert list(found)[:2] == ["plain-depth=3D", "plain-depth=4D"]
    assert "rough-depth=4D-diameter=1.75d" in found
    assert {one.number("grains.friction") for one in found.values()} == {0.5, 0.9}
    assert [[case.tables["seed"] for case in one.cases] for one in found.values()] == [
        *[[1, 2]] * 2,
        *[[1]] * 6,
    ]


def test_scale_is_chosen_by_name(study: Path):
    found = points(study, "large")
    assert len(found) == 3 + 9
    assert all(len(one.cases) == 3 for one in found.values())
    assert found["plain-depth=2D"].number("drive.distance") == pytest.approx(20 * 1.5 * 1.5e-3)
    with pytest.raises(InputError, match="choose one of small, large"):
        points(study, "huge")


def test_lists_together_are_gone_through_side_by_side(study: Path):
    """A scale may give those of one of its runs, in place of the run's own."""
    study.write_text(
        study.read_text()
        + """
[runs.deep]
case = "{case}"
grid = {{ "intruder.depth" = ["3 D"] }}
[runs.deep.together]
"tank.height" = ["20 d", "24 d", "28 d"]
"drive.speed" = ["0.1 m/s", "0.2 m/s", "0.3 m/s"]
[scales.large.runs.deep.together]
"tank.height" = ["30 d"]
"drive.speed" = ["0.4 m/s"]
""".format(case=study.parent / "tiny.toml")
    )
    small, large = points(study), points(study, "large")
    deep = {name: one for name, one in small.items() if one.run == "deep"}
    assert list(deep) == [f"deep-depth=3D-height={height}d" for height in (20, 24, 28)]
    assert [one.number("drive.speed") for one in deep.values()] == [0.1, 0.2, 0.3]
    assert [one.number("tank.height") for one in deep.values()] == pytest.approx(
        [0.03, 0.036, 0.042]
    )
    assert {one.number("drive.speed") for one in large.values() if one.run == "deep"} == {0.4}
    assert len([one for one in large.values() if one.run == "deep"]) == 3


def test_more_runs_than_can_be_are_refused_before_they_are_made(study: Path):
    study.write_text(study.read_text().replace("replicas = 2", "replicas = 5000", 1))
    with pytest.raises(InputError, match="10006 runs, more than 10000"):
        points(study)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('["3 D", "4 D"]', "[]", "grid"),
        ('["3 D", "4 D"]', '["3 D", "3  D"]', "called plain-depth=3D"),
        ('["3 D", "4 D"]', '["3 D", "-4 D"]', "intruder.depth"),
        ("replicas = 2", "replicas = 0", "replicas"),
        ("[runs.plain]", "[runs.'a b']", "runs"),
        ('title = "Depth"', 'title = "D"\nslurm = {nodes = 1}', "slurm.nodes"),
        ("replicas = 2", 'together = { "tank.height" = [1], "seed" = [1, 2] }', "equally long"),
        ("replicas = 2", 'together = { "intruder.depth" = [1] }', "keep one"),
        ("[scales.small]", "[scales.small.runs.none]", "no such run"),
    ],
)
def test_bad_grid_is_refused(study: Path, old: str, new: str, says: str):
    study.write_text(study.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=says):
        points(study)


def test_items_of_a_list_are_varied_by_number(tmp_path: Path):
    file = tmp_path / "rods.study"
    file.write_text(
        'title = "t"\n[runs.rods]\ncase = "shear/quick"\n'
        'set = { "species.1.aspect_ratio" = 0.5 }\n'
        'grid = { "species.0.aspect_ratio" = [4, 8] }\n'
    )
    found = points(file)
    assert list(found) == ["rods-aspect_ratio=4", "rods-aspect_ratio=8"]
    assert [one.number("species.0.aspect_ratio") for one in found.values()] == [4.0, 8.0]
    assert {one.number("species.1.aspect_ratio") for one in found.values()} == {0.5}
    with pytest.raises(InputError, match=r"no number at .species\.2\.aspect_ratio."):
        found["rods-aspect_ratio=4"].number("species.2.aspect_ratio")


def test_setting_of_what_is_varied_is_refused(study: Path):
    with pytest.raises(InputError, match=r"varies 'intruder.depth'"):
        points(study, None, "intruder.depth=2 D")


def test_claim_of_a_run_of_many_points_is_refused(study: Path):
    claim = '[[claims]]\nsays = "more"\nlarger = "plain"\nsmaller = "rough"\n'
    study.write_text(study.read_text() + claim)
    with pytest.raises(InputError, match="2 points; name one of them, such as plain-depth=3D"):
        points(study)


def test_digest_is_of_the_case_and_the_engine_alone(study: Path):
    one = next(iter(distinct(points(study).values()).values()))
    assert Task("other", one.case, one.engine).digest == one.digest
    assert Task(one.name, one.case, "lmp").digest != one.digest
    assert Task(one.name, one.case.set("seed", 9), one.engine).digest != one.digest
    assert len(distinct(points(study).values())) == 2 * 2 + 6


def drag(mean: float, error: float) -> State:
    found = Quantity(mean, error, "N", 1.0, 10.0, True)
    record = {"cpu_s": 2.0, "warnings": ["one"]}
    quantities = {"drag": found, "lift": replace(found, mean=0.25)}
    return State("finished", "", Path("runs/x"), quantities, record)


@pytest.mark.parametrize(("errors", "expected"), [(0.01, "scatter"), (10.0, "series")])
def test_error_of_a_point_is_the_larger_of_scatter_and_series(
    study: Path, errors: float, expected: str
):
    """By hand: deviation over the root of the count, or the root of the sum of squares over it."""
    point = points(study, "large")["plain-depth=3D"]
    means = [1.0, 1.5, 2.3]
    tasks = tasks_of(point)
    states = {task.digest: drag(mean, errors) for task, mean in zip(tasks, means, strict=True)}
    found = answer(point, states).quantities["drag"]
    by = {
        "scatter": np.std(means, ddof=1) / sqrt(3),
        "series": sqrt(3 * errors**2) / 3,
    }
    assert found.mean == pytest.approx(1.6)
    assert found.standard_error == pytest.approx(by[expected])


def test_point_answers_with_the_replicas_that_it_has(study: Path):
    """None, then one, as it is, then two, pooled: of three."""
    point = points(study, "large")["plain-depth=3D"]
    states = {task.digest: State("missing") for task in tasks_of(point)}
    assert answer(point, states).quantities == {}
    found = list[tuple[float, float]]()
    for digest, mean in zip(list(states)[1:], (1.5, 2.3), strict=True):
        states[digest] = drag(mean, 0.01)
        partial = answer(point, states)
        found.append((partial.quantities["drag"].mean, partial.quantities["drag"].standard_error))
        assert not partial.whole
    assert partial.replicas == (2, 3)
    assert found == [(1.5, 0.01), pytest.approx((1.9, np.std([1.5, 2.3], ddof=1) / sqrt(2)))]


def test_claim_on_a_point_without_all_its_replicas_is_not_decided(study: Path):
    """However clear it looks; it is with the last one."""
    text = study.read_text() + '[[claims]]\nsays = "more"\nlarger = "plain-depth=4D"\n'
    study.write_text(text + 'smaller = "plain-depth=3D"\n')
    plan, found = read(str(study)), points(study)
    less, more = found["plain-depth=3D"], found["plain-depth=4D"]
    states = {digest: State("missing") for digest in distinct(found.values())}
    said = list[tuple[float, float, str]]()
    for task in [*tasks_of(less), *tasks_of(more)]:
        states[task.digest] = drag(1.0 if task in tasks_of(less) else 9.0, 0.1)
        results = {name: answer(point, states) for name, point in found.items()}
        said += [(one.size, one.p_value < 1e-9, one.verdict) for _, one in findings(plan, results)]
    assert said == [(8.0, True, "unfinished"), (8.0, True, "supported")]


def test_point_says_of_how_many_replicas_it_is(study: Path, tmp_path: Path):
    """On the terminal, in the table and on the page; a whole one says nothing on the page."""
    plan, found = read(str(study)), points(study)
    states = {digest: drag(1.0, 0.1) for digest in distinct(found.values())}
    states[tasks_of(found["plain-depth=4D"])[0].digest] = State("running")
    results = {name: answer(point, states) for name, point in found.items()}
    with (tmp_path / "said").open("w") as file:
        shown = run_table(Studied(plan, tmp_path, results, []))
        Console(file=file, width=120).print(shown)
    said = [line for line in (tmp_path / "said").read_text().split("\n") if "replicas" in line]
    assert len(said) == 1
    assert re.search(r"plain-depth=4D .* 1\.00 ± 0\.10 N .*running, 1 of 2 replicas", said[0])
    write_tables(tmp_path, plan, results, [])
    rows = pd.read_csv(tmp_path / "points.csv").groupby("point")[["finished", "replicas"]].first()
    assert rows.loc["plain-depth=4D"].tolist() == [1, 2]
    assert rows.loc["plain-depth=3D"].tolist() == [2, 2]
    (names,) = (
        [row[0] for row in sheet.rows]
        for sheet in study_sheets(tmp_path)
        if sheet.headings[0] == "point"
    )
    assert names[:2] == ["plain-depth=3D", "plain-depth=4D (1 of 2 replicas)"]


def test_picture_has_errors_both_ways_and_open_markers(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """As matplotlib was told: 0.1 N and, of a lift against it, the same over the diameter."""
    study.write_text(
        study.read_text()
        + '[[pictures]]\nfile = "a.png"\ntitle = "t"\nagainst = "lift"\n'
        + 'over = "intruder.diameter"\ngroups = [["plain"]]\n'
        + '[[pictures]]\nfile = "b.png"\ntitle = "t"\ngroups = [["plain"]]\n'
    )
    panels, finish = list[Panel](), pictures._finish

    def watched(figure: Figure, panel: Panel, *rest: Any) -> None:
        panels.append(panel)
        finish(figure, panel, *rest)

    monkeypatch.setattr(pictures, "_finish", watched)
    plan, found = read(str(study)), points(study)
    states = {digest: drag(1.0, 0.1) for digest in distinct(found.values())}
    gone, done = tasks_of(found["plain-depth=4D"])
    states |= {gone.digest: State("missing"), done.digest: drag(2.0, 0.1)}
    draw(tmp_path, plan, {name: answer(point, states) for name, point in found.items()})
    lines, bars = panels
    (drawn,) = lines.containers
    assert drawn.has_xerr
    assert drawn.has_yerr
    across = drawn.lines[2][0].get_segments()
    big = 1.5 * 1.5e-3
    assert np.ptp(across[1], axis=0) == pytest.approx([2 * 0.1 / big, 0.0])
    open_ = [line for line in lines.lines if line.get_markerfacecolor() == "white"]
    assert [len(line.get_xdata()) for line in open_] == [1, 0]
    assert open_[0].get_xydata() == pytest.approx(np.array([[0.25 / big, 2.0]]))
    faces = [bar.get_facecolor()[3] for bar in bars.patches]
    assert faces == [1.0, 0.0, 0.0]
    for panel in panels:
        assert pictures.OPEN in [text.get_text() for text in panel.get_legend().get_texts()]


def test_tables_have_values_in_si_units_and_a_row_for_each_quantity(study: Path, tmp_path: Path):
    picture = (
        '[[pictures]]\nfile = "drag.png"\ntitle = "Drag"\nagainst = "intruder.depth"\n'
        'over = "intruder.diameter"\nlogarithmic = ["x"]\n'
        'reference = [{ value = 2.0, label = "paper" }]\n'
    )
    study.write_text(study.read_text() + picture)
    plan, found = read(str(study)), points(study)
    states = {digest: drag(1.0, 0.1) for digest in distinct(found.values())}
    for gone in tasks_of(found["plain-depth=4D"]):
        states[gone.digest] = State("failed", "lost_grains: 3")
    results = {name: answer(point, states) for name, point in found.items()}
    write_tables(tmp_path, plan, results, [])
    whole = pd.read_csv(tmp_path / "points.csv")
    assert len(whole) == 7 * 2 + 1
    rows = whole[whole["quantity"] != "lift"].set_index("point")
    assert rows.loc["plain-depth=3D", "intruder.depth"] == pytest.approx(3 * 1.5 * 1.5e-3)
    assert rows.loc["plain-depth=3D", "thickness/d"] == pytest.approx(3.0)
    assert rows.loc["plain-depth=3D", "length/D"] == pytest.approx(16 / 1.5)
    assert rows.loc["plain-depth=3D", "U0 (m/s)"] == 0.1
    assert rows.loc["plain-depth=4D", "reason"] == "lost_grains: 3"
    assert np.isnan(rows.loc["plain-depth=4D", "mean"])
    same = pd.read_parquet(tmp_path / "points.parquet")
    assert list(same.columns) == list(whole.columns)
    np.testing.assert_array_equal(same["mean"], whole["mean"])
    runs = pd.read_csv(tmp_path / "runs.csv")
    assert list(runs[runs.point == "plain-depth=4D"].status) == ["failed"] * 2
    assert list(rows.columns[6:9]) == ["grains.friction", "drive.distance", "intruder.depth"]
    draw(tmp_path, plan, results)
    assert (tmp_path / "drag.png").read_bytes().startswith(b"\x89PNG")


def test_what_varies_together_makes_no_lines_of_its_own(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """What is in the grid does."""
    sizes = '["1.5 d", "1.75 d", "2 d"]'
    study.write_text(
        study.read_text()
        .replace(
            f'grid = {{ "intruder.diameter" = {sizes}',
            f'together = {{ "intruder.diameter" = {sizes}',
        )
        .replace(sizes, f'{sizes}, "tank.height" = ["20 d", "21 d", "22 d"]')
        + '[[pictures]]\nfile = "one.png"\ntitle = "One"\nagainst = "intruder.diameter"\n'
    )
    drawn = list[list[Line]]()
    monkeypatch.setattr(
        "liftdrag.study.drawn.draw_lines", lambda _title, lines, *_rest: drawn.append(lines)
    )
    plan, found = read(str(study)), points(study)
    states = {digest: drag(1.0, 0.1) for digest in distinct(found.values())}
    draw(tmp_path, plan, {name: answer(point, states) for name, point in found.items()})
    ((plain_3, plain_4, rough_3, rough_4),) = drawn
    assert [line.label for line in (plain_3, rough_4)] == [
        "plain, intruder.depth = 3 D",
        "rough, intruder.depth = 4 D",
    ]
    assert len(plain_4.places) == 1
    assert rough_3.places == pytest.approx([k * 1.5e-3 for k in (1.5, 1.75, 2.0)])


def test_growth_of_a_run_is_fitted_and_written(study: Path, tmp_path: Path):
    """Points on 30 (1 - exp(-x/5)), x = h~/D: the plateau and 5 ln 10 come back."""
    study.write_text(
        study.read_text() + '[[saturations]]\nsays = "the lift"\nrun = "rough"\nquantity = "drag"\n'
    )
    plan, found = read(str(study)), points(study)
    states = dict[str, State]()
    for k, point in enumerate(found.values()):
        place = 2.0 + k
        depth = Quantity(place * point.number("intruder.diameter"), 1e-4, "m", 1.0, 9.0, True)
        one = drag(30.0 * (1.0 - exp(-place / 5.0)), 0.1)
        both = one.quantities | {"effective_depth": depth}
        states |= {task.digest: replace(one, quantities=both) for task in tasks_of(point)}
    results = {name: answer(point, states) for name, point in found.items()}
    grown = list(growths(plan, results))
    write_tables(tmp_path, plan, results, [], grown)
    row = pd.read_csv(tmp_path / "saturations.csv").iloc[0]
    assert (row.finished, row.points) == (6, 6)
    assert row.plateau == pytest.approx(30.0, rel=1e-4)
    assert row.depth == pytest.approx(5.0 * log(10.0), rel=1e-4)
    assert row.saturates


def test_growth_says_which_points_are_unfinished(study: Path, tmp_path: Path):
    """Of four points of two replicas one lacks one, and one has none at all."""
    growth = '[[saturations]]\nsays = "g"\nrun = "plain"\nquantity = "drag"\n'
    growth += 'against = "intruder.depth"\n'
    text = study.read_text().replace('["3 D", "4 D"]', '["2 D", "2.5 D", "3 D", "4 D"]')
    study.write_text(text + growth)
    plan, found = read(str(study)), points(study)
    first = [tasks_of(found[f"plain-depth={k}D"]) for k in (2, 2.5, 3)]
    states = {digest: State("missing") for digest in distinct(found.values())}
    states |= {task.digest: drag(1.0, 0.1) for tasks in first for task in tasks}
    states[first[2][1].digest] = State("running")
    results = {name: answer(point, states) for name, point in found.items()}
    (grown,) = growths(plan, results)
    assert (grown.finished, grown.points) == (2, 4)
    (line,) = growth_lines(Studied(plan, tmp_path, results, [], [grown]))
    assert "so far: 2 of 4 points have all their replicas." in line


def test_table_of_words_and_numbers_goes_to_parquet_as_words(tmp_path: Path):
    _write(pd.DataFrame({"key": ["soft", 1.5, None], "mean": [1.0, 2.0, 3.0]}), tmp_path / "t")
    found = pd.read_parquet(tmp_path / "t.parquet")
    assert list(found["key"][:2]) == ["soft", "1.5"]
    assert pd.isna(found["key"][2])


def test_lines_of_a_picture_are_those_of_a_naive_loop(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A line for each other value that is varied; one for each run against what was measured."""
    drawn = list[list[Line]]()
    monkeypatch.setattr(
        "liftdrag.study.drawn.draw_lines", lambda _title, lines, *_: drawn.append(lines)
    )
    for against in ("intruder.depth", "lift"):
        study.write_text(
            study.read_text()
            + f'[[pictures]]\nfile = "a.png"\ntitle = "t"\nagainst = "{against}"\n'
            'over = "intruder.diameter"\n'
        )
    plan, found = read(str(study)), points(study)
    states = {digest: drag(1.0, 0.1) for digest in distinct(found.values())}
    draw(tmp_path, plan, {name: answer(point, states) for name, point in found.items()})
    by_depth, by_lift = drawn
    assert [line.label for line in by_depth] == [
        "plain",
        *(f"rough, intruder.diameter = {big} d" for big in (1.5, 1.75, 2)),
    ]
    assert all(line.places == pytest.approx([3.0, 4.0]) for line in by_depth)
    assert [(line.label, len(line.places)) for line in by_lift] == [("plain", 2), ("rough", 6)]
    bigs = [1.5, 1.75, 2] * 2
    assert by_lift[1].places == pytest.approx([0.25 / (big * 1.5e-3) for big in bigs])


def test_lines_of_shear_flows_have_the_papers_curve_beside_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """At a solid fraction of 0.5 from S = 0.5 on; a group is called what its points share."""
    file = tmp_path / "s.study"
    file.write_text(
        'title = "S"\n[grid]\n"cell.solid_fraction" = [0.3, 0.5]\n'
        '[runs.rods]\ncase = "liu2020/rods"\n[runs.disks]\ncase = "liu2020/disks"\n'
        '[[pictures]]\nfile = "a.png"\ntitle = "t"\nquantity = "pressure"\nlogarithmic = ["y"]\n'
        'against = "order_parameter"\ncurve = "liu2020"\ngroups = [\n'
        '["disks-solid_fraction=0.3", "rods-solid_fraction=0.3"],\n'
        '["disks-solid_fraction=0.5", "rods-solid_fraction=0.5"]]\n'
    )
    drawn = list[Line]()
    lines = pictures.draw_lines
    monkeypatch.setattr(
        "liftdrag.study.drawn.draw_lines",
        lambda title, found, *rest: (drawn.extend(found), lines(title, found, *rest)),
    )
    plan, found = read(str(file)), points(file)
    states = {
        task.digest: State(
            "finished",
            quantities={
                "pressure": Quantity(1.0, 0.1, "1", 1.0, 50.0, True),
                "order_parameter": Quantity(order, 0.01, "1", 1.0, 50.0, True),
            },
        )
        for name, order in zip(found, (0.8, 0.9, 0.3, 0.4), strict=True)
        for task in tasks_of(found[name])
    }
    draw(tmp_path, plan, {name: answer(point, states) for name, point in found.items()})
    loose, dense = drawn
    assert [line.label for line in drawn] == ["solid_fraction=0.3", "solid_fraction=0.5"]
    assert loose.beside == ()
    assert (dense.beside[0][0], dense.beside[-1][0]) == (0.5, 0.9)
    assert dense.beside[-1][1] == pytest.approx(exp(-3.3785 * 0.9 + 2.8122))
    assert (tmp_path / "a.png").exists()
    file.write_text(file.read_text().replace('against = "order_parameter"', 'against = "pressure"'))
    with pytest.raises(InputError, match=r"no curve of pressure against pressure; set against"):
        read(str(file))


def test_spheres_are_refused_an_order_and_given_no_curve(tmp_path: Path):
    file = tmp_path / "s.study"
    balls = 'species = [{ shape = "sphere", share = 1 }]'
    drawn = '[[pictures]]\nfile = "a.png"\ntitle = "t"\nquantity = "shear_stress"\n'
    file.write_text(
        f'title = "S"\n[runs.a]\ncase = "liu2020/rods"\nset = {{ {balls} }}\n'
        f'{drawn}against = "order_parameter"\n'
    )
    with pytest.raises(
        InputError, match=r"^The run a .* is of spheres, without order_parameter\.$"
    ):
        points(file)
    mixed = balls.replace("share = 1 }", "share = 0.5 }, { aspect_ratio = 6, share = 0.5 }")
    file.write_text(file.read_text().replace(balls, mixed) + 'curve = "liu2020"\n')
    (picture,) = read(str(file)).pictures
    assert _curve(picture, list(points(file).values()), [0.6, 0.9]) == ()
