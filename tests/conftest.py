"""What the tests share: the flag for slow physics, a tiny tank, and runs of it."""

from __future__ import annotations

import os
import shutil
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import chromium
import pytest

from liftdrag.case import Case
from liftdrag.dem.compiled import _folder
from liftdrag.engines import engine
from liftdrag.errors import InputError
from liftdrag.result import Result
from liftdrag.runner import run

TINY = """
scene = "tank"
seed = 1
[grains]
diameter = "1.5 mm"
density = 2500
youngs_modulus = 5e6
poisson_ratio = 0.45
restitution = 0.6
friction = 0.5
[tank]
length = "16 d"
thickness = "3 d"
height = "12 d"
[intruder]
diameter = "1.5 d"
depth = "4 D"
[drive]
speed = "0.2 m/s"
distance = "6 D"
"""
"""A tank of some 600 grains about a cylinder hardly larger than they are."""

LONG = TINY.replace("6 D", "200 D")
"""The same tank, driven for about a minute."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--validate", action="store_true", help="also run the slow physics")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not config.getoption("--validate"):
        slow = [item for item in items if item.get_closest_marker("validate")]
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if item not in slow]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """A test of an engine that is not installed is skipped, but never in CI."""
    asked = {name for mark in item.iter_markers("needs") for name in mark.args}
    if callspec := getattr(item, "callspec", None):
        words = {value for value in callspec.params.values() if isinstance(value, str)}
        asked |= words & {"lmp", "liggghts"}
    for name in sorted(asked):
        if not os.environ.get("CI"):
            _skip_without(name)


_BESIDES: dict[str, Callable[[], object]] = {
    "slurm": lambda: shutil.which("sbatch"),
    "chromium": chromium.program,
}
"""Programs that are no engines, and what finds them."""


def _skip_without(name: str) -> None:
    if name in _BESIDES:
        if not _BESIDES[name]():
            pytest.skip(f"{name} is not installed")
        return
    try:
        engine(name).about()
    except InputError as missing:
        pytest.skip(str(missing))


def program(path: Path, *says: str, to: int = 1) -> Path:
    """An executable that prints these lines, whatever it is asked; `to` 2 is standard error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("#!/bin/sh\n" + "".join(f"echo '{line}' >&{to}\n" for line in says))
    path.chmod(0o755)
    return path


def tiny_tank(**tables: Any) -> Case:
    """The tiny tank, with these keys of its tables changed or added."""
    base = tomllib.loads(TINY)
    return Case("tiny", base | {key: base.get(key, {}) | table for key, table in tables.items()})


def with_lid(bulk_gravity: bool) -> Case:
    """The tiny tank under a lid, deep enough for one; its grains, pressed, may be driven faster."""
    return tiny_tank(
        tank={"height": "28 d"},
        intruder={"depth": "16 D"},
        drive={"speed": "0.4 m/s"},
        lid={"density_ratio": 60, "bulk_gravity": bulk_gravity},
    )


EXPERIMENTS = {
    "free surface": tiny_tank(),
    "lid": with_lid(bulk_gravity=True),
    "lid only": with_lid(bulk_gravity=False),
}


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What probes found is remembered for these tests, and nowhere else; beds are not.

    Commands that the tests start use the kernels that the tests have compiled.
    """
    cache = tmp_path_factory.mktemp("cache")
    (cache / "liftdrag").mkdir()
    (cache / "liftdrag" / "kernels").symlink_to(Path(_folder()).parent)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(cache))
        patch.setenv("LIFTDRAG_BEDS", "off")
        yield


@pytest.fixture(scope="session")
def result_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Result]:
    """Runs of the three experiments by name, each made once."""
    made: dict[str, Result] = {}

    def get(name: str) -> Result:
        if name not in made:
            made[name] = run(EXPERIMENTS[name], tmp_path_factory.mktemp("run"))
        return made[name]

    return get


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """A folder that does not exist yet."""
    return tmp_path / "out"
