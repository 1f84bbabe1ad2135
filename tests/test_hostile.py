"""Hostile input: refused in a sentence, before anything is written or computed."""

from __future__ import annotations

import math
import os
import re
import shutil
import sys
import tomllib
from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import test_drag2d_scene
import test_janssen_scene
import test_shear_scene
from conftest import TINY, tiny_tank
from hypothesis import given, settings
from hypothesis import strategies as st

from liftdrag.case import MAX_BYTES, Case, load
from liftdrag.cli import main
from liftdrag.cost import check_means, disk, machine
from liftdrag.deck import bodies, column, planar, tank
from liftdrag.deck import drag2d as deck2d
from liftdrag.deck import shear as sheared
from liftdrag.deck.commands import ANY, DECKS, check_commands
from liftdrag.deck.dialect import DIALECTS, Contact, Dialect
from liftdrag.engines import engine
from liftdrag.engines.base import silent
from liftdrag.engines.family import read_dump
from liftdrag.engines.mpi import World
from liftdrag.errors import CaseError, InputError, escaped
from liftdrag.folder import fresh
from liftdrag.numerics import JanssenNumerics, derive
from liftdrag.packing.tube import PackedColumn
from liftdrag.refusals import keys
from liftdrag.result import Result
from liftdrag.scene import SCENES, Drag2DScene, JanssenScene, ShearScene, TankScene

TEXTS = {
    "tank": TINY,
    "janssen": test_janssen_scene.TINY,
    "drag2d": test_drag2d_scene.TINY,
    "shear": test_shear_scene.TINY,
}
BASES = {name: tomllib.loads(text) for name, text in TEXTS.items()}
KEYS = [(scene, key) for scene, model in SCENES.items() for key in keys(model)]

NUMBERS = [math.nan, math.inf, -math.inf, 10**400, -(10**5000), "nan", "1e400", "1e308 km", -1]
EVIL = [
    "shell rm -rf /",
    "1 m\nshell rm",
    "1 m & shell rm",
    "${x}",
    "$(1+1)",
    "1 m # m",
    "'",
    '"',
    "1\0m",
    "é\u2028",
    "\x1b[31m",
    "../../etc/passwd",
    "x" * 100_000,
]
KINDS = [True, date(2014, 4, 1), [1.0], [[]], {"a": 1}, {}]

Typed = Callable[..., tuple[int, str, str]]


@pytest.fixture
def refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """What the command says when it refuses: a printable line, status 2, and nothing written."""
    monkeypatch.chdir(tmp_path)

    def type_(*words: str) -> str:
        before = sorted(tmp_path.iterdir())
        monkeypatch.setattr(sys, "argv", ["liftdrag", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr().err
        assert ended.value.code == 2, words
        assert said.endswith("\n")
        assert said[:-1].isprintable(), said
        assert sorted(tmp_path.iterdir()) == before
        return said

    return type_


def is_taken(key: str, value: object) -> bool:
    """Whether the value is a good one: the switches, and tables that need nothing."""
    flag = key in ("lid.bulk_gravity", "fill.curve") and value is True
    return flag or (key in ("numerics", "fields") and value == {})


@pytest.mark.parametrize(("scene", "key"), KEYS)
def test_hostile_value_of_any_key_is_refused(scene: str, key: str):
    for value in [*NUMBERS, *EVIL, *KINDS]:
        if is_taken(key, value):
            continue
        with pytest.raises(InputError) as caught:
            _ = Case("x", BASES[scene]).set(key, value).scene
        lines = str(caught.value).split("\n")
        assert all(line.isprintable() and line.endswith(".") for line in lines), lines
        assert len(str(caught.value)) < 2000
        if "." in key:
            assert any(line.startswith(key.split(".")[0]) for line in lines), lines


BOMBS = {
    "huge": "#" * (MAX_BYTES + 1),
    "a line": "x = 1 # " + "a" * 50_000,
    "arrays": "x = " + "[\n" * 20_000,
    "tables": "x = " + "{a=" * 300,
    "dots": "a." * 40_000 + "a = 1",
    "dots in a head": "[" + "a." * 40_000 + "a]",
    "dots of numbers": "[" + "1." * 40_000 + "1]",
    "dots after numbers": "x = [" + "1, " * 9_000 + "1]\n" + "a." * 40_000 + "a = 1",
    "numbers without an end": "x = [" + "1, " * 20_000 + " " * 39_000,
    "a long number": "x = [" + "1" * 99_000 + "x]",
    "dots a line each": "".join(f"[k{i}.{'a.' * 400}a]\n" for i in range(90)),
    "many tables": TINY + "".join(f"[t{i}]\n" for i in range(10_000)),
    "many keys": "".join(f"k{i} = 1\n" for i in range(9_000)) + TINY,
    "long array": TINY.replace("seed = 1", "seed = [" + "1,\n" * 30_000 + "]"),
    "hexadecimal": TINY.replace("density = 2500", "density = 0x" + "f" * 900),
    "digits": TINY.replace("seed = 1", "seed = " + "9" * 900),
    "1e400": TINY.replace("friction = 0.5", "friction = 1e400"),
    "text": TINY.replace("seed = 1", 'seed = """' + "a\n" * 40_000 + '"""'),
    "twice": TINY + "[tank]\n",
    "byte-order mark": "\ufeff" + TINY,
    "NUL": TINY + "\0",
    "NUL in a key": TINY + '"a\\u0000" = 1\n',
    "line in a key": '"a\\nb" = 1\n' + TINY,
    "colour in a key": '"\\u001b[31mX" = 1\n' + TINY,
    "half a character": 'scene = "\\ud800"',
    "Latin": b"\xff\xfe" + TINY.encode(),
    "UTF-16": TINY.encode("utf-16"),
    "nothing": "",
    "a line in the scene": TINY.replace('"tank"', '"tank\\nshell"'),
    "a day": TINY.replace("seed = 1", "seed = 1979-05-27"),
    "no day": TINY.replace("seed = 1", "seed = 1979-99-99"),
}


@pytest.mark.parametrize("name", BOMBS)
def test_file_that_is_no_case_is_refused(name: str, tmp_path: Path, refused: Callable[..., str]):
    content = BOMBS[name]
    (tmp_path / "x.toml").write_bytes(content if isinstance(content, bytes) else content.encode())
    if name.startswith("many"):
        with pytest.raises(InputError, match=r"And [0-9]+ more keys are wrong") as caught:
            _ = load(tmp_path / "x.toml").scene
        assert len(str(caught.value).split("\n")) == 11
        return
    refused("build-deck", "x.toml")


@pytest.mark.parametrize("kind", ["a folder", "a pipe", "a device", "a loop", "a link to nothing"])
@pytest.mark.parametrize("words", [["build-deck"], ["sweep"], ["analyze"], ["run"]])
def test_what_is_no_file_is_refused(
    kind: str, words: list[str], tmp_path: Path, refused: Callable[..., str]
):
    path = tmp_path / "x.toml"
    {
        "a folder": path.mkdir,
        "a pipe": lambda: os.mkfifo(path),
        "a device": lambda: path.symlink_to("/dev/zero"),
        "a loop": lambda: path.symlink_to(path),
        "a link to nothing": lambda: path.symlink_to("nowhere"),
    }[kind]()
    assert "x.toml" in refused(*words, "x.toml")


NAMES = ["../../etc/passwd", "/etc/passwd", "../quick", "quick/../x", "~", "quick.toml", "a\nb"]
NAMES += ["", "\x1b[31m.toml", "\udcff", "\udcff.toml", "a" * 5000, "a" * 5000 + ".toml"]
NAMES += ["/dev/zero", "/proc/self/environ", "a\nb.toml"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("command", ["run", "sweep", "bench", "cases"])
def test_name_of_no_case_is_refused(name: str, command: str, refused: Callable[..., str]):
    assert re.match(r"(There is no|The) (case|study) ", refused(command, name))


@pytest.mark.parametrize("name", ["../x", "/tmp/x", "a/../../x", "..", "."])
def test_case_name_that_leads_up_makes_no_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="is no name of a case"):
        fresh(None, name)
    assert list(tmp_path.iterdir()) == []


OUTS = ["file", "file/x", "full", "link", "dangling", "loop", "/dev/null", "/dev/null/x", "."]
OUTS += ["x/" * 3000, "a" * 300, "\udcff" * 300]


@pytest.mark.parametrize("command", ["run", "build-deck"])
@pytest.mark.parametrize("out", OUTS)
def test_folder_that_cannot_be_used_is_refused_before_any_work(
    command: str,
    out: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    refused: Callable[..., str],
):
    (tmp_path / "file").write_text("x")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").write_text("x")
    (tmp_path / "link").symlink_to("full")
    (tmp_path / "dangling").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.setattr(tank, "random_bed", None)
    refused(command, "quick", "--out", out)
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["x"]


def test_folder_without_permission_is_refused_before_any_work(
    monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
):
    """Root may write everywhere: the system's answer is made up."""
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr(tank, "random_bed", None)
    assert "Nothing can be written" in refused("run", "quick", "--out", "new")
    assert "Nothing can be written" in refused("run", "quick")


SETTINGS = ["", "=", "=1", ".=1", "a.b.c.d.e=1", "seed", "seed=", "seed.x=1", "scene.x=1"]
SETTINGS += ["grains=1", "a\nb=1", "\x1b[31m=1", "é=1", "\udcff=1", "scene=[1]", "stop=1"]
SETTINGS += ["stop.quantity=[]", "stop.relative_error=nan", "numerics.time_step=1e-300"]
SETTINGS += ["seed=0x" + "f" * 5000, "seed=" + "[" * 5000, "seed=1\n" + "a." * 40_000 + "a=1"]
SETTINGS += ["x" * 50_000 + "=1", "grains." + "x" * 50_000 + "=1", "numerics.sample_every=1e9"]
SETTINGS += [
    f"{key}={value}" for key in ("grains.diameter", "seed", "scene") for value in EVIL[:-1]
]


@pytest.mark.parametrize("setting", SETTINGS)
def test_hostile_setting_is_refused(setting: str, refused: Callable[..., str]):
    assert escaped(setting.partition("=")[0].strip()[:20]) in refused(
        "run", "quick", "--set", setting
    )


@pytest.mark.parametrize(
    ("case", "setting", "says"),
    [
        ("quick", "fields.foo=1", "fields.foo: this key is unknown; choose one of snapshots, "),
        ("quick", "drive.nope=1", "drive.nope: this key is unknown; choose one of speed, "),
        ("quick", "tank.depth=1", "tank.depth: this key is unknown; did you mean intruder.depth."),
        (
            "shear/quick",
            "species=[]",
            "species = []: this list has too few items; give at least 1.",
        ),
        (
            "shear/quick",
            "species.2.share=1",
            "species.2.share = 1: the list has no item '2'; choose one of 0, 1.",
        ),
        ("shear/quick", "species.-1.share=1", "species.-1.share = 1: the list has no item '-1'; "),
        ("shear/quick", "species.²=1", "species.² = 1: the list has no item '²'; "),
        ("shear/quick", "species.0=1", "species.0 = 1: this should be a table of keys; "),
        ("shear/quick", "species.0.x=1", "species.0.x: this key is unknown; choose one of shape, "),
        ("shear/quick", "species.1.shar=1", "species.1.shar: this key is unknown; did you mean "),
        ("shear/quick", "species.0.share=2", "species.0.share = 2: "),
    ],
)
def test_setting_is_refused_with_what_there_is(
    case: str, setting: str, says: str, refused: Callable[..., str]
):
    assert refused("run", case, "--set", setting).startswith(says)


def test_folder_without_a_whole_record_is_named(tmp_path: Path, refused: Callable[..., str]):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "run.json").write_text("{}")
    said = refused("run", "--resume", "--out", "old")
    assert said.startswith("The folder old holds no whole record of a run: its run.json is damaged")


STUDY = """title = "t"
[runs.a]
case = "quick"
[[claims]]
says = "x"
larger = "a"
smaller = "a"
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"t"', "1"),
        ("runs.a", 'runs."../x"'),
        ("runs.a", 'runs."a\\n"'),
        ('"quick"', '"../../etc/passwd"'),
        ('"quick"', '"/dev/zero"'),
        ('"quick"', '"a\\nb.toml"'),
        ('"quick"', '"quick"\nset = {seed = "shell rm"}'),
        ('"quick"', '"quick"\nset = {"a\\nb" = 1}'),
        ('"quick"', '"quick"\nset = {seed = nan}'),
        ('"t"', '"t"\nset = {"grains.diameter" = "1 m & shell"}'),
        ('"t"', '"t"\n"a\\nb" = 1'),
        ('larger = "a"', 'larger = "a\\nb"'),
        ('larger = "a"', 'larger = "a"\nquantity = "__class__"'),
        ('larger = "a"', 'larger = "a"\nwithin = nan'),
        (
            "[[claims]]",
            '[[pictures]]\nfile = "../x.png"\ntitle = "x"\ngroups = [["a"]]\n[[claims]]',
        ),
        ("[[claims]]", '[[pictures]]\nfile = "x.png"\ntitle = "x"\ngroups = [[]]\n[[claims]]'),
        (
            "[[claims]]",
            '[[pictures]]\nfile = "x.png"\ntitle = "x"\nagainst = "__class__"\n'
            'groups = [["a"]]\n[[claims]]',
        ),
    ],
)
def test_hostile_study_is_refused(old: str, new: str, tmp_path: Path, refused: Callable[..., str]):
    assert old in STUDY
    (tmp_path / "s.study").write_text(STUDY.replace(old, new, 1))
    refused("sweep", "s.study")


WORDS = [
    ('"t"', '"t"\nslurm = {time = "noon"}', "slurm.time = 'noon'", 'write it as "24:00:00"'),
    ('"t"', '"t"\nslurm = {mem = "2 GB"}', "slurm.mem = '2 GB'", 'write it as "2G"'),
    ('"t"', '"t"\nslurm = {qos = "a b"}', "slurm.qos = 'a b'", 'write it as "long"'),
    ('"t"', '"t"\nslurm = {modules = ["$x"]}', "slurm.modules.0 = '$x'", '"openmpi/4.1"'),
    ('"t"', '"t"\nslurm = {mem = "2G\\n"}', r"slurm.mem = '2G\n'", "write it as"),
    (
        "[[claims]]",
        '[[pictures]]\nfile = "x.pdf"\ntitle = "x"\n[[claims]]',
        "pictures.0.file = 'x.pdf'",
        'write it as "lift.png"',
    ),
    (
        'larger = "a"',
        'larger = "aa"',
        "claims = 'aa': no run or point has this name",
        "choose one of a.",
    ),
    (
        "[[claims]]",
        '[[saturations]]\nsays = "x"\nrun = "b"\n[[claims]]',
        "saturations.run = 'b': ",
        "choose one of a.",
    ),
    ("runs.a]", "runs.'a b']", "runs.a b = 'a b'", "letters, digits"),
    ('"quick"', '"quick"\n[runs.a.gird]\nseed = [1]', "runs.a.gird: ", "mean runs.a.grid."),
    ("[runs", "[run", "run: this key is unknown", "did you mean runs."),
    (
        '"quick"',
        '"quick"\nset = {"drive.nope" = 1}',
        "drive.nope: ",
        "choose one of speed, distance.",
    ),
    ('"quick"', '"quick"\ngrid = {seed = []}', "runs.a.grid.seed = []", "give at least 1."),
    ('"quick"', '"quick"\ngrid = {seed = [[1]]}', "runs.a.grid.seed.0 = [1]", "a number"),
    (
        '"quick"',
        '"shear/quick"\ngrid = {"species.2.share" = [0.5]}',
        "species.2.share = 0.5: the list has no item '2'",
        "choose one of 0, 1.",
    ),
    ('larger = "a"', 'larger = "a"\nquantity = "dragg"', "claims.0.quantity = 'dragg'", "drag."),
]


@pytest.mark.parametrize(("old", "new", "key", "remedy"), WORDS)
def test_study_is_refused_with_its_key_its_value_and_a_remedy(
    old: str, new: str, key: str, remedy: str, tmp_path: Path, refused: Callable[..., str]
):
    (tmp_path / "s.study").write_text(STUDY.replace(old, new, 1))
    said = refused("sweep", "s.study")
    assert said.startswith(key)
    assert remedy in said
    assert "^" not in said


@pytest.mark.parametrize(
    "words",
    [
        ["--sign", "nan"],
        ["--sign", "1e+308"],
        ["--discard", "nan"],
        ["--discard", "-1"],
        ["--unit", "a\nb"],
        ["--unit", "x" * 1000],
        ["--drag", "9" * 5000],
        ["--drag", "²"],
        ["--drag", "\n"],
        ["--time-step", "nan"],
        ["--time-step", "-1"],
        ["--form", "x\ny"],
        ["--bench", "/dev/zero"],
        ["--bench", "a" * 5000],
    ],
)
def test_hostile_option_of_analyze_is_refused(
    words: list[str], tmp_path: Path, refused: Callable[..., str]
):
    rows = "".join(f"{i},{i % 7}e300,{i % 5}\n" for i in range(500))
    (tmp_path / "t.csv").write_text("time,drag,lift\n" + rows)
    path = "t.csv" if words[0] != "--bench" else "."
    assert escaped(words[-1])[:40] in refused("analyze", path, *words)


@pytest.mark.parametrize(
    "words",
    [
        ["run", "quick", "--ranks", "99999999999"],
        ["run", "quick", "--replicas", "-1"],
        ["run", "quick", "--engine", "shell\nrm"],
        ["run", "quick", "--engine", "lmp", "--engine-path", "/dev/null"],
        ["run", "quick", "--ignore-probe", "x\ny"],
        ["bench", "quick", "--budget", "nan"],
        ["bench", "quick", "--budget", "9" * 400 + "s"],
        ["bench", "quick", "--axes", "x\ny"],
        ["bench", "quick", "--jobs", "0"],
    ],
)
def test_hostile_option_is_refused(words: list[str], refused: Callable[..., str]):
    assert escaped(words[-1])[:40] in refused(*words)


def test_text_that_rich_would_obey_is_printed_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    rows = "".join(f"{i},{i % 7},{i % 5}\n" for i in range(500))
    (tmp_path / "t.csv").write_text("time,drag,lift\n" + rows)
    words = ["liftdrag", "analyze", str(tmp_path / "t.csv"), "--unit", "[/x]"]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert "[/x]" in capsys.readouterr().out


LINES = [
    "shell rm -rf /",
    "\tshell ls",
    "run 0\vshell ls",
    "run 0\rshell ls",
    "run 0 &",
    "# a comment &",
    'print """',
    "print 'a#' \"shell rm\"",
    "if '1 > 0' then \"print 'a#'\" \"shell rm\"",
    "if\t'1 > 0' then 'shell rm'",
    "if '1 > 0' then'shell rm'",
    "if '1 > 0' then 'print x' else 'shell rm'",
    "if ' then print x' then 'shell rm'",
    "if '1 > 0' then 'jump in.other a'",
    "if '1 > 0' then \"print 'x' file y\"",
    "if '1 > 0' then ''",
    "print 'a' \"file\" x",
    "print 'a' \"append\" '/etc/x'",
    "print $(shell)",
    "print '$(python x)'",
    "print '${X}'",
    "variable x equal $x",
    "variable x getenv HOME",
    "variable x string a",
    "read_data '/etc/passwd'",
    "read_data a/../../x",
    "read_data x;rm.gz",
    "dump d all custom 1 x.gz id",
    "dump d all custom/gz 1 forces.dat id",
    "write_dump all custom other.dump id",
    "fix f all ave/time 1 1 1 v_x file other.dat",
    "fix f all ave/time 1 1 1 v_x \"file\" '../x'",
    "fix f all rigid molecule infile /etc/x",
    "processors 1 1 1 file x",
    "region r mesh/tet file x scale 1",
    "pair_style eam",
    "atom_style template x",
    "run 10 every 1 'shell rm'",
    "include other.lmp",
    "include stop.lmp other.lmp",
    "next other",
    "jump SELF elsewhere",
    "quit",
    "python f invoke",
    "plugin load x.so",
    "log x",
    "timestep nan",
    "neighbor inf bin",
    "pair_coeff * * -inf",
    "run 1é",
]


@pytest.mark.parametrize("deck", DECKS)
def test_line_outside_the_list_of_its_deck_is_refused(deck: str):
    for line in LINES:
        with pytest.raises(ValueError, match="which is not allowed"):
            check_commands(f"units si\n{line}\n", deck)


def test_what_one_deck_may_another_may_not():
    only = {"include stop.lmp": "in.tank", "jump SELF average_1": "in.janssen"}
    only |= {"dimension 2": "in.drag2d", "read_data bodies.data": "in.bodies"}
    for line, deck in only.items():
        check_commands(line, deck)
        for other in [name for name in DECKS if name.split("-")[0] != deck]:
            with pytest.raises(ValueError, match="which is not allowed"):
                check_commands(line, other)


def tank_text(case: Case, dialect: Dialect) -> str:
    scene = case.scene
    assert isinstance(scene, TankScene)
    types = np.array([1, 2, 3] if scene.lid else [1, 2])
    bed = tank.Bed(np.ones((len(types), 3)) * scene.grains.diameter, types)
    deck = tank.build(scene, derive(scene), case.name, "1", 2, True, dialect, bed)
    return "\n".join(deck.texts.values())


def column_text(case: Case, dialect: Dialect) -> str:
    scene = case.scene
    assert isinstance(scene, JanssenScene)
    d, numerics = scene.grains.diameter, derive(scene)
    assert isinstance(numerics, JanssenNumerics)
    lid = np.ones((2 if scene.overload else 0, 3)) * d
    packed = PackedColumn(np.ones((max(scene.grain_count % 50, 1), 3)) * d, lid)
    deck = column.build(scene, numerics, packed, case.name, "1", 2, dialect)
    return "\n".join(deck.texts.values())


def planar_text(case: Case, dialect: Dialect, clump: int = 0) -> str:
    scene = case.scene
    assert isinstance(scene, Drag2DScene)
    width, size = scene.box.width, np.full(3, scene.grains.diameter / 2.0)
    bed = planar.PlanarBed(
        np.full((3, 2), width / 2.0), size, np.full(3, scene.mass), np.array([0, 1, 2 - clump]),
        width, scene.height, np.full(2, width / 2.0), scene.intruder.diameter / 2.0,
        np.array([0.0, scene.drive.speed]),
    )  # fmt: skip
    contact, steps = deck2d.contact_of(scene), deck2d._steps(derive(scene))
    return "\n".join(planar.build(contact, bed, steps, dialect, case.name, "1").texts.values())


def cell_text(case: Case, _dialect: Dialect) -> str:
    scene = case.scene
    assert isinstance(scene, ShearScene)
    return sheared._text(scene, derive(scene), 1)


TEXT_OF = {"tank": tank_text, "janssen": column_text, "drag2d": planar_text, "shear": cell_text}


def bodies_text(wall: bodies.Wall | None, dialect: Dialect) -> str:
    contact, one = Contact(1e7, 0.3, 0.5, 0.2, 1e-3, 2e-3), np.zeros((1, 3))
    few = bodies.Bodies(2500.0, one, one, one, wall, 9.81)
    return bodies.build(contact, few, bodies.Steps(1e-6, 10), dialect).texts["in.bodies"]


@pytest.mark.parametrize("name", ["lammps", "lmp", "liggghts"])
def test_engine_runs_in_a_folder_of_any_name(name: str, tmp_path: Path):
    chosen, folder = engine(name), tmp_path / "a b é ' \" $(x) & # ; \udcff"
    still = bodies.Bodies(2500.0, np.eye(3)[:2], np.zeros((2, 3)), np.zeros((2, 3)))
    contact = Contact(1e7, 0.3, 0.5, 0.2, 1e-3)
    deck = bodies.build(contact, still, bodies.Steps(1e-6, 10), chosen.dialect)
    deck.write(folder)
    assert chosen.run(deck.plan, folder, silent, alone=True).status == "finished"
    assert [step for step, _ in read_dump(folder / bodies.MOTION)] == list(range(11))


def every_deck() -> Iterator[tuple[str, str]]:
    """The name and the text of decks that hold all that the templates can say."""
    stop, lid = {"relative_error": 0.1}, {"density_ratio": 60, "bulk_gravity": True}
    deep = {"tank": {"height": "28 d"}, "intruder": {"depth": "16 D"}}
    hertz = {"contact": "hertz", "poisson_ratio": 0.3}
    tube, small = test_janssen_scene.tiny, test_drag2d_scene.tiny
    for dialect in DIALECTS:
        fields = tiny_tank(fields={"snapshots": 8})
        for case in (tiny_tank(), tiny_tank(stop=stop), tiny_tank(lid=lid, **deep), fields):
            yield "in.tank", tank_text(case, dialect)
        columns = [tube(), tube(stop=stop), tube(overload={"mass": "1 g"})]
        if dialect.name != "lammps-2021":
            columns.append(tube(grains=hertz))
        for case in columns:
            yield "in.janssen", column_text(case, dialect)
        for clump in (0, 1):
            yield "in.drag2d", planar_text(small(), dialect, clump)
        for wall in (None, "plane", "cylinder"):
            yield "in.bodies", bodies_text(wall, dialect)


def test_lists_hold_nothing_that_no_deck_says():
    """Of commands, styles and files: what a template does not use, a deck may not hold."""
    said: dict[str, set[str]] = {name: set() for name in DECKS}
    for name, text in every_deck():
        said[name] |= set(re.findall(r"[^\s\"']+", re.sub("#.*", "", text)))
    assert set.union(*said.values()) >= ANY
    for name in ("in.tank", "in.janssen", "in.drag2d", "in.bodies"):
        rules = DECKS[name]
        assert said[name] >= rules.commands - ANY
        assert said[name] >= rules.files


def scaled(value: Any, by: float) -> Any:
    """A number, or text with a unit, so many times as large."""
    if isinstance(value, str):
        number, space, unit = value.partition(" ")
        return f"{float(number) * by:.6g}{space}{unit}"
    return round(value * by) if isinstance(value, int) else value * by


LEAVES = {
    name: [f"{part}.{key}" for part, table in base.items() if isinstance(table, dict)
           for key, value in table.items() if re.match(r"[\d.]+", str(value))]
    for name, base in BASES.items()
}  # fmt: skip

anything = st.recursive(
    st.one_of(
        st.integers(), st.floats(), st.booleans(), st.text(max_size=20), st.sampled_from(EVIL)
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=4,
)

STATES = {"deck": 0, "refused": 0}


def answer_of(ask: Callable[[], str]) -> tuple[str, str]:
    """What an InputError says, or else the answer."""
    try:
        return "", ask()
    except InputError as error:
        return str(error), ""


@given(
    st.sampled_from(sorted(BASES)),
    st.sampled_from(DIALECTS),
    st.randoms(use_true_random=False),
    st.integers(0, 3),
    st.none() | st.tuples(st.sampled_from(KEYS), anything),
)
@settings(max_examples=150, deadline=None)
def test_case_gives_a_good_deck_or_is_refused(scene, dialect, rng, changes, mutation):
    """Wide values and random ones: finite numbers and allowed commands, or an InputError."""
    case = Case(rng.choice(["x", *EVIL]), BASES[scene])
    for key in rng.sample(LEAVES[scene], changes):
        part, name = key.split(".")
        case = case.set(key, scaled(BASES[scene][part][name], 10.0 ** rng.uniform(-3.0, 3.0)))
    if mutation:
        (_, key), value = mutation
        try:
            case = case.set(key, value)
        except CaseError:
            return
    said, text = answer_of(lambda: TEXT_OF[scene](case, dialect))
    STATES["refused" if said else "deck"] += 1
    assert all(line.isprintable() for line in said.split("\n"))
    assert not re.search(r"(?<![\w.])[-+]?(nan|inf)(?![\w.])", text)
    assert text.isascii()


def test_neither_all_nor_none_of_the_random_cases_are_refused():
    test_case_gives_a_good_deck_or_is_refused()
    assert STATES["deck"] > 20
    assert STATES["refused"] > 20


def test_run_without_the_memory_is_refused_unless_a_job_spreads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
):
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal: 100 kB\nMemAvailable: 50 kB\n")
    monkeypatch.setattr(machine, "MEMINFO", meminfo)
    monkeypatch.setattr(tank, "random_bed", None)
    for case in ("quick", "zhou/c1", "janssen/quick", "shear/quick"):
        said = refused("run", case, "--engine", "dem" if case != "quick" else "lammps")
        assert "GB of memory" in said
        assert "fewer grains or ranks" in said
    scene, chosen = tiny_tank().scene, engine("lammps")
    monkeypatch.setattr(type(chosen), "world", lambda _: World(0, 2))
    assert check_means(scene, derive(scene), chosen, 2, None) is None


def test_container_has_less_memory_than_its_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for name, text in (("MEMINFO", "MemTotal: 100 kB\n"), ("CONTAINER", "max\n")):
        (tmp_path / name).write_text(text)
        monkeypatch.setattr(machine, name, tmp_path / name)
    assert machine.whole_memory() == 100 * 1024
    (tmp_path / "CONTAINER").write_text("5000\n")
    assert machine.whole_memory() == 5000


def test_run_without_the_room_is_refused(
    monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
):
    monkeypatch.setattr(disk, "free", lambda _: 1_000_000)
    monkeypatch.setattr(tank, "random_bed", None)
    for case in ("quick", "zhou/c1", "janssen/quick", "shear/quick"):
        said = refused("run", case, "--engine", "dem" if case != "quick" else "lammps")
        assert "are free at runs" in said


def test_bytes_of_a_run_are_foreseen(result_of: Callable[[str], Result]):
    folder = result_of("free surface").folder
    wrote = sum(path.stat().st_size for path in folder.iterdir() if path.suffix != ".png")
    scene = tiny_tank().scene
    plain = disk.needed(scene, derive(scene)) - disk.REST
    assert 0.9 * wrote < plain < 2.0 * wrote
    assert disk.needed(scene, derive(scene), dump=True) > 2.0 * plain


def test_room_is_that_of_the_nearest_folder_there_is(tmp_path: Path):
    assert disk.free(tmp_path / "a" / "b") == pytest.approx(
        shutil.disk_usage(tmp_path).free, rel=0.1
    )


def test_tube_that_is_nearly_empty_is_refused_before_it_is_packed():
    with pytest.raises(CaseError, match=r"^tube\.diameter = 100: .*mostly empty.* narrower"):
        derive(test_janssen_scene.tiny(tube={"diameter": "100 m"}).scene)


@given(st.floats(0.3, 3.0), st.floats(8.0, 300.0), st.floats(0.05, 0.95), st.floats(3.0, 50.0))
@settings(max_examples=50, deadline=None)
def test_box_of_a_tank_is_never_mostly_empty(size: float, high: float, deep: float, wide: float):
    """So the engine's bins of half a grain are never many more than its grains."""
    case = tiny_tank(
        grains={"diameter": 1e-3},
        tank={"height": 1e-3 * high, "length": 0.3, "thickness": 1e-3 * wide},
        intruder={"diameter": 1e-3 * size * 10.0, "depth": 1e-3 * high * deep},
        drive={"distance": 0.5},
    )
    try:
        scene = case.scene
    except InputError:
        return
    assert isinstance(scene, TankScene)
    volume = scene.tank.length * scene.tank.thickness * tank._headroom(scene)
    assert volume / (0.5e-3) ** 3 < 150.0 * scene.grain_count
