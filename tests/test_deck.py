"""The deck: what the template asks for, which commands it may hold, what the data file says."""

from __future__ import annotations

from dataclasses import replace
from importlib import resources
from math import pi
from pathlib import Path
from typing import Any

import jinja2
import jinja2.meta
import numpy as np
import pytest
from jinja2 import nodes

import liftdrag.deck.tank
from liftdrag.case import Case, load, packaged
from liftdrag.deck import Deck
from liftdrag.deck.commands import DECKS, check_commands
from liftdrag.deck.dialect import DIALECTS, LAMMPS, LIGGGHTS, Dialect
from liftdrag.deck.tank import build
from liftdrag.deck.template import render, template
from liftdrag.errors import CaseError
from liftdrag.numerics import derive
from liftdrag.packing.relaxation import TOLERANCE

ROOT = Path(str(resources.files("liftdrag.templates")))
D, DENSITY, RATIO = 1.5e-3, 2500.0, 60.0

FREE = Case(
    "free",
    {
        "scene": "tank",
        "seed": 1,
        "grains": {
            "diameter": D,
            "density": DENSITY,
            "youngs_modulus": 5e6,
            "poisson_ratio": 0.45,
            "restitution": 0.6,
            "friction": 0.5,
        },
        "tank": {"length": "12.4 d", "thickness": "4.3 d", "height": "9 d"},
        "intruder": {"diameter": "1.5 d", "depth": "3 d"},
        "drive": {"speed": 0.1, "distance": "8 D"},
    },
)


def under_lid(name: str, bulk_gravity: bool) -> Case:
    """The case under a lid, the cylinder as deep as the lid demands."""
    deep = FREE.set("tank.height", "21 d").set("intruder.depth", "16 D")
    deep = deep.set("intruder.diameter", "1 d").set("tank.length", "9 d")
    deep = deep.set("tank.thickness", "4 d")
    deep = deep.set("lid", {"density_ratio": RATIO, "bulk_gravity": bulk_gravity})
    return Case(name, deep.tables)


EXPERIMENTS = {
    "free surface": FREE,
    "lid": under_lid("lid", True),
    "lid alone has weight": under_lid("weightless", False),
}
TEMPLATES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in ROOT.rglob("*.j2")
    if not path.name.startswith("report.")
)
"""Every packaged template of a deck."""

dialect = pytest.mark.parametrize("dialect", DIALECTS, ids=lambda dialect: dialect.name)
experiment = pytest.mark.parametrize("case", EXPERIMENTS.values(), ids=EXPERIMENTS.keys())


def deck_of(case: Case, name: str | None = None, dialect: Dialect = LAMMPS) -> Deck:
    """The deck of a case."""
    return build(case.scene, derive(case.scene), name or case.name, "1.2.3", dialect=dialect)


@pytest.fixture(scope="module")
def decks() -> dict[str, Deck]:
    """The packed decks of the three experiments by the name of their case."""
    return {case.name: deck_of(case) for case in EXPERIMENTS.values()}


@pytest.fixture
def unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Grains at random instead of a packed bed: for what does not depend on where they are."""
    monkeypatch.setattr(
        liftdrag.deck.tank, "random_bed", lambda _, count, rng: rng.uniform(0.0, 5.0, (count, 3))
    )


def context_of(case: Case, monkeypatch: pytest.MonkeyPatch, dialect: Dialect) -> dict[str, Any]:
    """What a deck's template is filled in with."""
    seen: list[dict[str, Any]] = []

    def keep(name: str, context: dict[str, Any]) -> str:
        assert name == f"{dialect.folder}/tank.in.j2"
        seen.append(dict(context))
        return ""

    with monkeypatch.context() as patch:
        patch.setattr(liftdrag.deck.tank, "render", keep)
        deck_of(case, dialect=dialect)
    return seen[0]


def asked(name: str) -> set[str]:
    """The names that a template asks for, and those that it includes or extends."""
    tree = jinja2.Environment(trim_blocks=True, lstrip_blocks=True).parse(template(name))
    names = jinja2.meta.find_undeclared_variables(tree)
    for other in jinja2.meta.find_referenced_templates(tree):
        names |= asked(other)
    return names


def atoms(deck: Deck) -> np.ndarray:
    """The rows of the data file: id, type, diameter, density, x, y, z."""
    text = deck.texts["grains.data"].split("Atoms\n\n")[1]
    return np.array([line.split() for line in text.splitlines()], dtype=float)


def header(deck: Deck) -> dict[str, list[float]]:
    """The numbers of the data file's head by what they count."""
    lines = deck.texts["grains.data"].split("\nAtoms\n")[0].splitlines()[2:]
    pairs = [line.split() for line in lines if line]
    return {
        " ".join(w for w in words if w.isalpha()): [float(w) for w in words if not w.isalpha()]
        for words in pairs
    }


def commands(text: str) -> list[str]:
    """The first word of each line that is no comment."""
    lines = (line.partition("#")[0].split() for line in text.splitlines())
    return [words[0] for words in lines if words]


@pytest.mark.usefixtures("unpacked")
@dialect
@experiment
def test_template_uses_every_number_and_no_other(
    case: Case, monkeypatch: pytest.MonkeyPatch, dialect: Dialect
):
    names = asked(f"{dialect.folder}/tank.in.j2")
    assert names == set(context_of(case, monkeypatch, dialect))


@pytest.mark.usefixtures("unpacked")
@dialect
def test_number_that_is_missing_is_an_error(monkeypatch: pytest.MonkeyPatch, dialect: Dialect):
    case = EXPERIMENTS["lid"].set("stop", {"relative_error": 0.1})
    context = context_of(case, monkeypatch, dialect)
    name = f"{dialect.folder}/tank.in.j2"
    assert render(name, context)
    for missing in context:
        rest = {key: value for key, value in context.items() if key != missing}
        with pytest.raises(jinja2.UndefinedError, match=f"'{missing}' is undefined"):
            render(name, rest)


def test_drive_through_the_skin_in_a_step_is_refused_for_liggghts():
    """It would stop the run; LAMMPS would not."""
    fast = FREE.set("drive.speed", 6.0)
    with pytest.raises(CaseError, match=r"^drive\.speed = 6: .* where LIGGGHTS stops"):
        deck_of(fast, dialect=LIGGGHTS)


@dialect
def test_grains_are_the_same_for_every_engine(dialect: Dialect, decks: dict[str, Deck]):
    other = deck_of(FREE, dialect=dialect)
    assert other.texts["grains.data"] == decks["free"].texts["grains.data"]


@pytest.mark.parametrize("name", TEMPLATES)
def test_template_computes_nothing(name: str):
    tree = jinja2.Environment(trim_blocks=True, lstrip_blocks=True).parse(template(name))
    shown = {type(child) for output in tree.find_all(nodes.Output) for child in output.nodes}
    tested = {type(branch.test) for branch in tree.find_all(nodes.If)}
    assert shown <= {nodes.TemplateData, nodes.Name}
    assert tested <= {nodes.Name, nodes.Compare}
    for test in tree.find_all(nodes.Compare):
        assert isinstance(test.expr, nodes.Name)
        assert [(o.op, type(o.expr)) for o in test.ops] == [("eq", nodes.Const)]
    computing = (nodes.BinExpr, nodes.UnaryExpr, nodes.Filter, nodes.Call, nodes.Concat)
    others = (nodes.Getattr, nodes.Getitem, nodes.Assign, nodes.For)
    assert list(tree.find_all((*computing, *others))) == []


@pytest.mark.parametrize(
    "line",
    [
        "shell rm -rf /",
        "  shell ls",
        "\tshell ls",
        "run 0\nshell ls",
        "run 0\r\nshell ls",
        "print a &\nshell ls",
        "# a comment &\nshell ls",
        "python f invoke",
        "include other.in",
        "jump SELF here",
        "plugin load evil.so",
        "${command} ls",
        "'shell' ls",
        "SHELL ls",
        "next i",
        "clear",
        "read_restart file",
        "read_restart /etc/drive-from.restart",
        "restart 10 a b",
        "restart 10 settle-a.restart drive-b.restart",
        "restart 10 settle-a.restart settle-b.restart fileper 1",
        "write_restart file",
        "run 100 upto every 10 'shell ls'",
        "if 1 then 'run 10 every 1 \"shell ls\"'",
        "if 1 then 'run 10' else 'shell ls'",
        "write_data file",
        "package gpu 1",
        "suffix omp",
        "quit",
        "if 1 then 'shell ls'",
        'if 1 then "jump in.other a" else "print b"',
        "if 1 then shell",
        "variable x getenv HOME",
        "variable x file secrets",
        "print 'a' file /etc/x",
        "print 'a' append /etc/x",
        'run 100 every 10 "shell touch x"',
        "if 1 then\t'shell ls'",
        "fix p all print 1 x file y",
        "fix p all python/invoke 1 end_of_step f",
        "read_data /etc/passwd",
        "read_data ../other",
        "dump d all custom 1 /root/x id",
    ],
)
def test_command_outside_the_list_is_refused(line: str):
    with pytest.raises(ValueError, match="which is not allowed"):
        check_commands(f"units si\n{line}\nrun 0\n", "in.tank")


def test_allowed_commands_and_comments_pass():
    text = "# shell ls\n\n   # jump SELF\nunits si # shell\n  run 0\n"
    assert check_commands(text, "in.tank") is None
    assert commands(text) == ["units", "run"]


def test_list_holds_no_command_that_runs_programs_or_reads_scripts():
    dangerous = {"shell", "python", "include", "jump", "plugin", "next", "log", "info"}
    for rules in DECKS.values():
        assert not rules.commands & dangerous


TANKS = [case for case in map(load, packaged()) if case.tables["scene"] == "tank"]


@pytest.mark.usefixtures("unpacked")
@pytest.mark.parametrize("case", [*TANKS, *EXPERIMENTS.values()], ids=lambda case: case.name)
def test_deck_of_every_case_holds_allowed_commands_only(case: Case):
    text = deck_of(case).texts["in.tank"]
    assert set(commands(text)) <= DECKS["in.tank"].commands | {"restart"}
    assert commands(text).count("run") + text.count('then "run ') == 2
    assert "{{" not in text
    assert "{%" not in text
    assert not any(line.rstrip().endswith("&") for line in text.splitlines())


@pytest.mark.usefixtures("unpacked")
@pytest.mark.parametrize(
    "name",
    ["x\nshell rm -rf /", "x\r\nshell", "x &\nshell", "${x}", "$(1+1)", "{{ seed }}", "é\u2028a"],
)
def test_hostile_name_stays_a_comment(name: str):
    plain, hostile = deck_of(FREE, "plain"), deck_of(FREE, name)
    lines = zip(
        plain.texts["in.tank"].splitlines(), hostile.texts["in.tank"].splitlines(), strict=True
    )
    changed = [found for expected, found in lines if expected != found]
    assert len(changed) == 1
    assert changed[0].startswith("# Case ")
    assert not set(changed[0]) & set("&${}\x0b\u2028")
    assert hostile.texts["grains.data"] == plain.texts["grains.data"]


@pytest.mark.usefixtures("unpacked")
def test_long_name_is_cut():
    longest = max(deck_of(FREE, "x" * 10_000).texts["in.tank"].splitlines(), key=len)
    assert len(longest) < 300


@experiment
def test_data_file_holds_each_layer(case: Case, decks: dict[str, Deck]):
    scene, rows = case.scene, atoms(decks[case.name])
    columns, rows_across = int(scene.tank.length / D + 1e-9), int(scene.tank.thickness / D + 1e-9)
    layer = columns * rows_across
    layers = [scene.grain_count, layer] if scene.lid is None else [scene.grain_count, layer, layer]
    head = header(decks[case.name])
    assert np.bincount(rows[:, 1].astype(int))[1:].tolist() == layers
    assert head["atoms"] == [sum(layers)]
    assert head["atom types"] == [len(layers)]
    assert rows[:, 0].tolist() == list(range(1, sum(layers) + 1))


@experiment
def test_grains_of_the_lid_alone_are_heavy(case: Case, decks: dict[str, Deck]):
    rows = atoms(decks[case.name])
    lid = rows[:, 1] == 3
    assert np.all(rows[:, 2] == D)
    assert np.all(rows[~lid, 3] == DENSITY)
    assert np.all(rows[lid, 3] == RATIO * DENSITY)
    assert lid.any() == (case.scene.lid is not None)


@experiment
def test_grains_lie_inside_the_box_that_the_data_file_states(case: Case, decks: dict[str, Deck]):
    rows, head, tank = atoms(decks[case.name]), header(decks[case.name]), case.scene.tank
    assert head["xlo xhi"] == pytest.approx([0.0, tank.length], rel=1e-11)
    assert head["ylo yhi"] == pytest.approx([0.0, tank.thickness], rel=1e-11)
    box = np.array([head[name] for name in ("xlo xhi", "ylo yhi", "zlo zhi")])
    assert np.all(rows[:, 4:] >= box[:, 0])
    assert np.all(rows[:, 4:] <= box[:, 1])
    assert rows[:, 6].max() + D / 2.0 < box[2, 1]


@experiment
def test_bed_is_packed_loosely_under_its_packed_height(case: Case, decks: dict[str, Deck]):
    scene, rows = case.scene, atoms(decks[case.name])
    grains = rows[rows[:, 1] == 1]
    tank, bare = scene.tank, pi * scene.intruder.diameter**2 / 4.0
    area = tank.length * (scene.packed_height - 0.8 * D)
    fraction = len(grains) * pi * D**3 / 6.0 / ((area - bare) * tank.thickness)
    assert fraction == pytest.approx(0.59, rel=1e-9)
    assert tank.height < scene.packed_height < 1.02 * tank.height
    assert scene.packed_height - D < grains[:, 6].max() < scene.packed_height - 0.49 * D


@experiment
def test_no_grain_overlaps_the_cylinder_of_the_deck(case: Case, decks: dict[str, Deck]):
    lines = map(str.split, decks[case.name].texts["in.tank"].splitlines())
    (line,) = (words for words in lines if words[:3] == ["region", "cylinder", "cylinder"])
    x, z, radius = map(float, line[4:7])
    rows = atoms(decks[case.name])
    away = np.hypot(rows[:, 4] - x, rows[:, 6] - z)
    assert away.min() > radius + D / 2.0 - TOLERANCE * D
    assert (x, z) == pytest.approx((case.scene.axis_x, case.scene.axis_height), rel=1e-9)
    assert radius == pytest.approx(case.scene.intruder.diameter / 2.0, rel=1e-9)


@experiment
def test_no_two_grains_of_the_data_file_overlap(case: Case, decks: dict[str, Deck]):
    centres = atoms(decks[case.name])[:, 4:]
    period = np.array([case.scene.tank.length, case.scene.tank.thickness])
    apart = centres[:, None, :] - centres[None, :, :]
    apart[..., :2] -= period * np.rint(apart[..., :2] / period)
    distance = np.sqrt((apart**2).sum(axis=2))
    np.fill_diagonal(distance, np.inf)
    assert distance.min() > (1.0 - TOLERANCE) * D * (1.0 - 1e-9)


def test_same_case_gives_the_same_deck(decks: dict[str, Deck]):
    again = deck_of(FREE)
    assert again.texts == decks["free"].texts
    assert again.digest == decks["free"].digest


def test_other_seed_gives_another_bed(decks: dict[str, Deck]):
    other = deck_of(FREE.set("seed", 2))
    assert other.texts["grains.data"] != decks["free"].texts["grains.data"]
    assert other.digest != decks["free"].digest


@pytest.mark.usefixtures("unpacked")
@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("seed", 2),
        ("grains.diameter", 1.50001e-3),
        ("grains.density", 2500.001),
        ("grains.youngs_modulus", 5.00001e6),
        ("grains.poisson_ratio", 0.450001),
        ("grains.restitution", 0.600001),
        ("grains.friction", 0.500001),
        ("tank.length", "12.4001 d"),
        ("tank.thickness", "4.3001 d"),
        ("tank.height", "9.0001 d"),
        ("intruder.diameter", "1.50001 d"),
        ("intruder.depth", "3.00001 d"),
        ("drive.speed", 0.100001),
        ("drive.distance", "8.01 D"),
        ("numerics.time_step", 1.000001e-5),
        ("numerics.skin", "0.11 d"),
        ("numerics.sample_every", 3),
        ("numerics.settle_time", 0.5),
    ],
)
def test_digest_changes_with_any_number(key: str, value: object):
    assert deck_of(FREE.set(key, value)).digest != deck_of(FREE).digest


def test_digest_covers_the_files_names_and_not_their_order(decks: dict[str, Deck]):
    deck = decks["free"]
    turned = dict(reversed(deck.texts.items()))
    renamed = {f"x{name}": text for name, text in deck.texts.items()}
    assert replace(deck, texts=turned).digest == deck.digest
    assert replace(deck, texts=renamed).digest != deck.digest


def test_written_deck_is_the_deck(decks: dict[str, Deck], tmp_path: Any):
    decks["free"].write(tmp_path / "new" / "folder")
    written = {p.name: p.read_text("utf-8") for p in (tmp_path / "new" / "folder").iterdir()}
    assert written == decks["free"].texts


@experiment
def test_gravity_acts_on_the_layers_that_have_weight(case: Case, decks: dict[str, Deck]):
    text = decks[case.name].texts["in.tank"]
    words = [line.split() for line in text.splitlines()]
    weighed = {line[2] for line in words if "gravity" in line and line[0] == "fix"}
    expected = {"grains"} if case.scene.bulk_gravity else set()
    if case.scene.lid is not None:
        expected.add("lid")
    assert weighed == expected


@experiment
def test_plan_agrees_with_the_deck(case: Case, decks: dict[str, Deck]):
    deck, numerics = decks[case.name], derive(case.scene)
    text = deck.texts[deck.plan.start]
    assert f"index {deck.plan.stages['drive']}\n" in text
    assert f"run          {deck.plan.stages['settle']}\n" in text
    assert f"index {deck.plan.time_step:.10g} " in text
    assert deck.plan.row_every == numerics.row_every.value
    for file, channels in deck.plan.series.items():
        (line,) = (x for x in text.splitlines() if x.endswith(f" file {file}"))
        every, samples, row = map(int, line.split()[4:7])
        assert [w for w in line.split() if w.startswith("v_")] == [f"v_{c}" for c in channels]
        assert every * samples <= row == deck.plan.row_every


@experiment
def test_lid_presses_on_the_far_field_with_its_weight(case: Case, decks: dict[str, Deck]):
    text, rows = decks[case.name].texts["in.tank"], atoms(decks[case.name])
    (line,) = (x for x in text.splitlines() if x.startswith("variable     overburden"))
    stated = float(line.partition("#")[0].rsplit("+", 1)[1])
    mass = rows[rows[:, 1] == 3, 3].sum() * np.pi * D**3 / 6.0
    area = case.scene.tank.length * case.scene.tank.thickness
    assert stated == pytest.approx(mass * 9.81 / area, rel=1e-9)
