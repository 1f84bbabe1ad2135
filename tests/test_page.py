"""The page of a run: what it shows is what the folder holds, and it is sound HTML."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from collections.abc import Callable, Mapping
from html.parser import HTMLParser
from itertools import pairwise
from math import hypot
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import program, tab
from conftest import tiny_tank

from liftdrag import replicas
from liftdrag.analysis.quantity import Quantity, rounded
from liftdrag.case import load
from liftdrag.cli import main
from liftdrag.deck.template import template
from liftdrag.folder import put
from liftdrag.page import report
from liftdrag.page.chart import HEIGHT, WIDTH, charts
from liftdrag.page.comparison import REFERENCES, compared
from liftdrag.page.record import RunRecord
from liftdrag.result import Result
from liftdrag.runner import run

CSS = "report.css.j2"

HOSTILE = '<script>alert(1)</script>"><img src=x onerror=alert(1)> & \x1b[31m'

VOID = {"meta", "link", "img"}

PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d49484452000000010000000108060000001f15c489"
    "0000000d49444154789c6360606060000000050001a5f645400000000049454e44ae426082"
)
"""A PNG of one pixel."""


class Read(HTMLParser):
    """A naive reader: elements with their attributes, their own text, and tables by caption."""

    def __init__(self, page: str):
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, list[str]]] = []
        self.tables: list[tuple[str, list[list[str]]]] = []
        self._open: list[tuple[str, list[str]]] = []
        self.feed(page)
        assert not self._open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag in VOID:
            return
        self._open.append((tag, []))
        self.texts.append(self._open[-1])
        if tag == "tr":
            self.tables[-1][1].append([])

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        opened, parts = self._open.pop()
        assert opened == tag
        if tag == "caption":
            self.tables.append(("".join(parts), []))
        if tag in ("td", "th"):
            self.tables[-1][1][-1].append("".join(parts))
        if tag in ("a", "span"):
            self._open[-1][1].extend(parts)

    def handle_data(self, data: str) -> None:
        if self._open:
            self._open[-1][1].append(data)

    def table(self, words: str) -> dict[str, list[str]]:
        """The rows of the first table whose caption begins so, by their first cell."""
        rows = next(rows for caption, rows in self.tables if caption.startswith(words))
        return {row[0]: row[1:] for row in rows}

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]

    def said(self, tag: str) -> list[str]:
        return ["".join(parts).strip() for name, parts in self.texts if name == tag]


def read(folders: list[Path], out: Path) -> Read:
    return Read(report(folders, out).read_text("utf-8"))


def quantity(mean: float, error: float, unit: str = "1") -> dict[str, Any]:
    return Quantity(mean, error, unit, None, 40.0, True).to_dict()


def made(folder: Path, tables: Mapping[str, Any], **result: Any) -> Path:
    """A folder with the records of a run."""
    folder.mkdir(parents=True)
    begun = {"case": "made", "tables": tables, "engine": "lammps", "warnings": ["foreseen"]}
    (folder / "run.json").write_text(json.dumps(begun))
    if result:
        whole = {"case": "made", "scene": tables["scene"], "status": "finished", **result}
        (folder / "result.json").write_text(json.dumps(whole))
    return folder


@pytest.fixture(scope="module")
def tank(result_of: Callable[[str], Result]) -> Result:
    return result_of("free surface")


@pytest.fixture
def page(tank: Result, out: Path) -> Read:
    return read([tank.folder], out.with_suffix(".html"))


def test_every_answer_has_its_row(page: Read, tank: Result):
    answers = page.table("Answers")
    for name, found in tank.quantities.items():
        mean, _, interval, samples, meaning = answers[name.replace("_", " ")]
        assert mean.startswith(" ± ".join(rounded(found.mean, found.standard_error)))
        assert interval == "{:.4g} to {:.4g}".format(*found.interval_95)
        assert samples.startswith(f"{found.n_independent:.0f}")
        assert ("not converged" in samples) != found.converged
        assert meaning
    assert answers["drag"][1] == "N"
    assert len(answers) == len(tank.quantities) + 1


def test_nothing_that_the_record_says_is_left_out(page: Read, tank: Result):
    assert set(tank.warnings) <= set(page.said("li"))
    assert page.table("The case file")["intruder.depth"] == ["4 D"]
    reasons = [row[2] for row in page.table("Numbers that liftdrag derived").values()]
    lines = (tank.folder / "numerics.txt").read_text().splitlines()
    assert len(reasons) == 1 + sum(not line.startswith("WARNING") for line in lines)
    assert "0.15 of the smaller of the Rayleigh and Hertz times" in reasons
    balance = tank.record["invariants"]["horizontal_balance"]
    assert page.table("What a sound run keeps")["horizontal balance"] == [
        f"{balance['value']:.4g}",
        f"{balance['bound']:.4g}",
        "N",
        "yes",
    ]
    assert "stiffness" in page.table("Error budget")["drag"][2]
    origin = page.table("By what")
    assert origin["SHA-256 of the deck"] == [tank.record["provenance"]["deck_sha256"]]
    assert origin["engine"] == [f"lammps {tank.record['engine']['version']}"]
    assert "pair restitution" in page.table("Probes")


def test_the_pictures_are_those_of_the_folder(page: Read, tank: Result):
    found = [b64decode((one["src"] or "").partition("base64,")[2]) for one in page.all("img")]
    assert found == [(tank.folder / name).read_bytes() for name in ("forces.png", "bed.png")]
    assert page.all("img")[0]["width"] == "1200"


def check_sound(page: Read) -> None:
    """One h1, no level left out, tables and pictures that can be read aloud, nothing from afar."""
    assert page.all("html") == [{"lang": "en"}]
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h[1-6]", tag)]
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert all(below <= level + 1 for level, below in pairwise(levels))
    assert len(page.all("table")) == len(page.all("caption")) == len(page.tables)
    assert {one.get("scope") for one in page.all("th")} <= {"col", "row"}
    assert all(one["alt"] for one in page.all("img"))
    assert all(one["aria-label"] for one in page.all("svg"))
    ids = [one["id"] for _, one in page.elements if "id" in one]
    assert len(ids) == len(set(ids))
    places = [one.get("src") or one.get("href") or "data:" for _, one in page.elements]
    assert all(place.startswith(("data:", "#")) for place in places)
    assert {place[1:] for place in places if place.startswith("#")} <= set(ids)
    assert not page.all("script")


def test_the_page_is_sound(page: Read):
    check_sound(page)


def test_several_come_with_a_table_of_them_all(tank: Result, tmp_path: Path):
    other = made(tmp_path / "b", load("zhou/c1").tables, quantities={"drag": quantity(9, 1, "N")})
    page = read([tank.folder, other], tmp_path / "page.html")
    check_sound(page)
    listed = page.table("All on this page")
    assert listed["made"] == ["finished", str(other), "9.0 ± 1.0 N", "-", "-", "-"]
    assert listed["tiny"][4] == " ± ".join(
        rounded(
            *(tank.record["quantities"]["drag_coefficient"][k] for k in ("mean", "standard_error"))
        )
    )
    assert [one["href"] for one in page.all("a")] == ["#run-1", "#run-2", "#all", "#all"]


@pytest.mark.parametrize(
    "where", ["case", "warnings", "tables", "csv", "numerics", "log", "folder"]
)
def test_what_a_user_wrote_is_shown_and_not_obeyed(where: str, tmp_path: Path):
    tables = dict(tiny_tank().tables) | ({HOSTILE: HOSTILE} if where == "tables" else {})
    name = HOSTILE.replace("/", "_") if where == "folder" else "run"
    folder = made(tmp_path / name, tables, status="timeout", warnings=[HOSTILE])
    result = json.loads((folder / "result.json").read_text())
    result |= {"case": HOSTILE} if where == "case" else {}
    (folder / "result.json").write_text(json.dumps(result))
    (folder / "packings.csv").write_text(f"{HOSTILE}\n{HOSTILE}\n")
    (folder / "numerics.txt").write_text(f"{HOSTILE}\n")
    (folder / "log.lammps").write_text(f"{HOSTILE}\n")
    page = read([folder], tmp_path / "page.html")
    check_sound(page)
    assert not page.all("img")
    assert any(
        "<script>alert(1)" in text for text in map("".join, (parts for _, parts in page.texts))
    )


def test_a_run_that_failed_says_why_and_what_the_engine_said_last(tmp_path: Path):
    reason = "timeout: the run took 4 s"
    folder = made(
        tmp_path / "run",
        tiny_tank().tables,
        status="timeout",
        warnings=[reason, "foreseen"],
        quantities={},
    )
    (folder / "log.lammps").write_text(
        "".join(f"line {n}\n" for n in range(40)) + "ERROR: lost\n\n"
    )
    page = read([folder], tmp_path / "page.html")
    check_sound(page)
    assert page.said("span")[0] == "timeout"
    assert page.said("li") == [reason, "foreseen"]
    assert page.said("pre")[0].splitlines() == [f"line {n}" for n in range(29, 40)] + [
        "ERROR: lost"
    ]
    assert page.said("h3")[:3] == [
        "Why there are no answers",
        "The engine's last lines",
        "Warnings",
    ]


def test_a_packing_that_failed_says_why(tmp_path: Path):
    folder = made(tmp_path / "run", load("zhou/c1").tables, status="engine_error")
    for number, status in enumerate(("finished", "engine_error"), start=1):
        place = folder / f"packing-00{number}"
        place.mkdir()
        outcome = {"status": status, "reason": f"packing {number}", "evidence": "it blew up"}
        (place / "outcome.json").write_text(json.dumps(outcome))
    assert read([folder], tmp_path / "p.html").said("pre") == ["packing 2\nit blew up"]


def test_a_run_without_a_result_is_shown_as_such(tmp_path: Path):
    folder = made(tmp_path / "run", tiny_tank().tables)
    page = read([folder], tmp_path / "page.html")
    check_sound(page)
    assert page.said("span")[0] == "no result"
    assert page.table("The case file")["scene"] == ["tank"]


def test_replicas_are_shown_one_by_one_and_pooled(tmp_path: Path):
    folder = tmp_path / "many"
    for number, drag in ((1, 1.0), (2, 3.0)):
        one = made(
            folder / f"replica-00{number}",
            tiny_tank().tables,
            seed=number,
            quantities={"drag": quantity(drag, 0.5, "N")},
        )
        (one / "forces.png").write_bytes(PIXEL)
    (folder / replicas.CASE).write_text(
        json.dumps({"case": "x", "tables": dict(tiny_tank().tables)})
    )
    whole = {"case": "x", "scene": "tank", "status": "finished", "replicas": 2}
    answers = {"quantities": {"drag": quantity(2.0, 0.4, "N")}}
    (folder / "result.json").write_text(json.dumps(whole | answers))
    page = read([folder], tmp_path / "page.html")
    check_sound(page)
    assert page.table("Answers")["drag"][0].startswith("2.00 ± 0.40")
    each = page.table("Each replica")
    assert each["replica-001"] == ["finished", "1", "1.00 ± 0.50 N"]
    assert each["replica-002"] == ["finished", "2", "3.00 ± 0.50 N"]
    assert len(page.all("img")) == 1


def test_a_study_shows_its_runs_claims_and_pictures(tmp_path: Path):
    folder = tmp_path / "study"
    made(folder / "c1", load("zhou/c1").tables, quantities={"drag": quantity(9, 1, "N")})
    made(folder / "e1", load("zhou/e1").tables)
    before = read([folder], tmp_path / "before.html")
    assert before.table("Runs")["e1"] == ["no result", "-", "-"]
    (folder / "drag.png").write_bytes(PIXEL)
    (folder / "runs.csv").write_text(
        "run,quantity,mean,standard_error,unit\nc1,drag,9,1,N\nc1,irregularity,0.5,0.01,1\n"
    )
    (folder / "claims.csv").write_text(
        "claim,quantity,size,standard_error,unit,p_value,verdict\n"
        'c1 drags more,drag,5,1,N,0.00012,supported\n"a, b",drag,,,,,\n'
    )
    page = read([folder], tmp_path / "page.html")
    check_sound(page)
    claims = page.table("Claims")
    assert claims["c1 drags more"] == ["5.0 ± 1.0 N", "0.00012", "supported"]
    assert claims["a, b"] == ["-", "-", "-"]
    assert page.table("Every quantity")["c1"] == ["9.0 ± 1.0 N", "0.500 ± 0.010"]
    assert len(page.all("img")) == 1


def test_a_study_of_grids_shows_its_points_and_what_it_lacks(tmp_path: Path):
    folder = tmp_path / "study"
    made(folder / "runs" / "a-1f", load("zhou/c1").tables, quantities={"drag": quantity(9, 1, "N")})
    (folder / "runs.csv").write_text("run,point,status\na,a,finished\nb,a,missing\n")
    (folder / "points.csv").write_text(
        "point,status,quantity,mean,standard_error,unit\na,missing,drag,9,1,N\n"
    )
    (folder / "saturations.csv").write_text(
        "says,quantity,plateau,plateau_error,depth,depth_error,saturates,finished,points\n"
        "small,lift_coefficient,30,2,11,1,True,4,5\nlarge,lift_coefficient,1,2,3,4,False,5,5\n"
    )
    page = read([folder], tmp_path / "page.html")
    check_sound(page)
    assert any("1 unfinished" in part for _, parts in page.texts for part in parts)
    assert page.table("Runs")["a-1f"][0] == "finished"
    assert page.table("Every quantity of every point")["a"] == ["9.0 ± 1.0 N"]
    assert page.table("Where it saturates") == {
        "of": ["quantity", "plateau", "90 % of it at", "finished points"],
        "small": ["lift coefficient", "30.0 ± 2.0", "11.0 ± 1.0", "4 of 5"],
    }


def test_a_paper_is_compared_with_its_own_case_only():
    lid, found = load("guillard2014/lid"), {"drag_coefficient": Quantity(11, 1, "1", None, 9, True)}
    (same,) = compared(lid.tables, found)
    assert same.difference == f"{(11 - 10) / hypot(1, 1):+.1f} combined standard errors"
    longer = lid.set("seed", 9).set("drive.distance", "20 D").set("tank.length", "210 mm")
    assert compared(longer.tables, found) == [same]
    (other,) = compared(lid.set("tank.thickness", "9 d").tables, found)
    assert other.difference == "not the paper's case, which has another tank.thickness"
    assert compared(dict(lid.tables) | {"scene": "unknown"}, found) == []
    assert compared(dict(lid.tables) | {"later": {}}, found) == []
    lifts = {"lift_coefficient": Quantity(30, 4, "1", None, 9, True)}
    assert [row.there for row in compared(lid.tables, lifts)] == ["30.0 ± 3.0"]
    (none,) = compared(load("guillard2014/lid-only").tables, lifts)
    assert (none.there, none.difference) == ("0", "+7.5 combined standard errors")
    both = compared(load("zhou/c1").tables, {"drag": Quantity(1295, 50, "N", None, 9, True)})
    assert [row.there for row in both] == ["1295 ± 104 N", "1405 ± 107 N"]
    (balance,) = compared(
        load("janssen/quick").tables, {"weight_balance": Quantity(1.1, 0.05, "1", None, 9, True)}
    )
    assert balance.difference == "+2.0 combined standard errors"


def test_the_references_are_of_packaged_cases():
    for one in REFERENCES:
        assert {load(case).scene.scene for case in one.cases} <= {one.scene}


@pytest.mark.parametrize("rows", [7, 1000])
def test_a_chart_is_the_series_scaled(rows: int, tmp_path: Path):
    time, values = np.linspace(0.0, 3.0, rows), np.sin(np.arange(rows)) + 2.0
    lines = [f"{t!r},{v!r}" for t, v in zip(time.tolist(), values.tolist(), strict=True)]
    (tmp_path / "series.csv").write_text("time (s),drag (N)\n" + "\n".join(lines) + "\n")
    record = {"case": "x", "scene": "tank", "status": "finished"}
    answers = {"drag": quantity(2.0, 0.1, "N")}
    window = {"start_s": 1.0, "end_s": 2.0}
    known = RunRecord.model_validate(record | {"quantities": answers, "steady_window": window})
    (chart,) = charts(tmp_path, known)
    low, high = values.min(), values.max()

    def points(path: str) -> np.ndarray:
        return np.array(re.findall(r"[-\d.]+", path), float).reshape(-1, 2)

    line, band = points(chart.line), points(chart.band)
    middle = HEIGHT * (high - 2.0) / (high - low)
    assert band[:, 1].min() == 0.0
    assert band[:, 1].max() == HEIGHT
    assert chart.mean == pytest.approx(middle, abs=0.06)
    assert chart.steady == pytest.approx((WIDTH / 3.0, WIDTH / 3.0), abs=0.1)
    assert "mean 2.00 ± 0.10 N" in chart.summary
    if rows == 7:
        expected = [
            (WIDTH * t / 3.0, HEIGHT * (high - v) / (high - low))
            for t, v in zip(time, values, strict=True)
        ]
        np.testing.assert_allclose(line, expected, atol=0.051)
    else:
        assert len(line) == 240
        assert line[:, 1].mean() == pytest.approx(
            HEIGHT * (high - values.mean()) / (high - low), abs=0.2
        )


def refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: object
) -> str:
    monkeypatch.setattr("sys.argv", ["liftdrag", "report", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err.strip()
    assert ended.value.code == 2
    assert said.count("\n") == 0
    return said


def test_bad_input_gets_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    good = made(tmp_path / "run", tiny_tank().tables)
    (tmp_path / "empty").mkdir()
    (tmp_path / "page.html").mkdir()
    damaged = made(tmp_path / "damaged", tiny_tank().tables, quantities={"drag": {"mean": "high"}})
    for words, says in (
        ([tmp_path / "nowhere"], "There is no folder"),
        ([good, tmp_path / "empty"], "holds no run of liftdrag"),
        ([damaged], "is damaged at quantities.drag"),
        ([good, "--out", tmp_path / "page.html"], "Is a directory"),
        ([good, "--out", tmp_path / "no" / "page.html"], "No such file or directory"),
        ([good, "--out", good / "result.json"], "ends in .html"),
    ):
        assert says in refused(monkeypatch, capsys, *words)
    assert not list(tmp_path.rglob("*.part"))


def test_a_page_that_cannot_be_written_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    page = tmp_path / "page.html"
    put(page, "old")

    def full(_self: Path, _target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match="No space"):
        put(page, "new")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("page.html", "old")]


def test_the_series_of_a_run_that_was_cut_short_is_drawn(tmp_path: Path):
    (tmp_path / "forces.dat").write_text(
        "# Time-averaged data for fix forces\n# TimeStep v_drag v_lift\n10 1 0\n20 3 0\n30 2 0\n"
    )
    known = RunRecord.model_validate({"case": "x", "scene": "tank", "status": "timeout"})
    drag, lift = charts(tmp_path, known)
    assert drag.summary == "drag against time step: from 1 to 3."
    assert (drag.axis, drag.first, drag.last) == ("time step", "10", "30")
    assert drag.line == f"M0.0 {HEIGHT:.1f}L300.0 0.0L600.0 {HEIGHT / 2:.1f}"
    assert lift.title == "lift"


def contrast(one: str, other: str) -> float:
    """The ratio of two colours' luminances (WCAG 2)."""

    def luminance(colour: str) -> float:
        parts = [int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_text_stands_out_in_light_and_in_dark():
    schemes = [
        dict(re.findall(r"--(\w+): (#\w{6})", part)) for part in template(CSS).split(":root")
    ]
    light, dark = schemes[1:3]
    for scheme in (light, dark):
        for ink in ("ink", "soft", "accent", "good", "bad"):
            for ground in ("page", "card"):
                assert contrast(scheme[ink], scheme[ground]) > 4.5
        for ground in ("note", "alarm"):
            assert contrast(scheme["ink"], scheme[ground]) > 4.5


@pytest.mark.validate
@pytest.mark.parametrize("name", ["janssen/quick", "zhou/c1"])
def test_other_scenes_are_shown_as_well(name: str, tmp_path: Path):
    case = load(name)
    result = run(case if "janssen" in name else case.set("ensemble.runs", 2), tmp_path / "run")
    page = read([result.folder], tmp_path / "page.html")
    check_sound(page)
    assert len(page.table("Answers")) == len(result.quantities) + 1
    assert len(page.all("img")) == 2
    assert len(page.all("svg")) >= 4
    assert "combined standard errors" in list(page.table("Beside the paper").values())[1][2]


@pytest.mark.needs("chromium")
def test_a_browser_shows_all_of_it(tank: Result, tmp_path: Path):
    chromium = program()
    assert chromium is not None
    wide = made(tmp_path / ("w" * 120), tiny_tank().tables, warnings=["x" * 300])
    page = report([tank.folder, wide], tmp_path / "page.html")
    with tab(chromium, tmp_path / "profile") as browser:
        for width in (360, 1200):
            browser.open(page, width)
            assert browser.value("document.documentElement.scrollWidth") <= width
            sizes = browser.value("[...document.images].map(i => [i.naturalWidth, i.clientWidth])")
            assert [natural for natural, _ in sizes] == [1200, 1000]
            assert all(0 < shown < width for _, shown in sizes)
            drawn = browser.value(
                "[...document.querySelectorAll('svg .line')].map(p => p.getTotalLength())"
            )
            assert len(drawn) == 7
            assert min(drawn) > 100
            assert browser.value("document.querySelector('.scroll table').offsetWidth") > 360
        asked = [one["request"]["url"] for one in browser.heard("Network.requestWillBeSent")]
        assert [url for url in asked if not url.startswith("data:")] == [page.resolve().as_uri()]
        assert not browser.heard("Log.entryAdded")
        assert not browser.heard("Runtime.exceptionThrown")
        browser.ask("Emulation.setEmulatedMedia", media="print")
        assert browser.value("document.querySelector('details .scroll').offsetHeight") > 100
