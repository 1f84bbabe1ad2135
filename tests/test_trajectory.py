"""The trajectory as others' programs read it: the dump by a naive reader, the VTK by VTK."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import pyvista
from conftest import TINY, tiny_tank

from liftdrag import trajectory
from liftdrag.cli import main
from liftdrag.errors import InputError
from liftdrag.folder import Record
from liftdrag.runner import run
from liftdrag.scene import TankScene
from liftdrag.trajectory import write_vtk

CASE = tiny_tank(drive={"distance": "4 D"})


@dataclass
class Frame:
    step: int
    bounds: list[list[float]]
    columns: dict[str, list[float]]


def frames(dump: Path, edges: str = "pp pp f") -> list[Frame]:
    """The frames of a text dump, word by word."""
    lines, found = iter(dump.read_text().splitlines()), []
    for line in lines:
        assert line == "ITEM: TIMESTEP"
        step = int(next(lines))
        assert next(lines) == "ITEM: NUMBER OF ATOMS"
        count = int(next(lines))
        assert next(lines).startswith(f"ITEM: BOX BOUNDS {edges}")
        bounds = [[float(word) for word in next(lines).split()] for _ in range(3)]
        names = next(lines).removeprefix("ITEM: ATOMS ").split()
        rows = [[float(word) for word in next(lines).split()] for _ in range(count)]
        found.append(
            Frame(step, bounds, dict(zip(names, map(list, zip(*rows, strict=True)), strict=True)))
        )
    return found


@pytest.fixture(
    scope="module", params=["lammps", pytest.param("liggghts", marks=pytest.mark.needs("liggghts"))]
)
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp(request.param)
    return run(CASE, out, request.param, dump=True).folder


def test_the_dump_has_what_ovito_draws(folder: Path):
    scene = CASE.scene
    assert isinstance(scene, TankScene)
    found = frames(folder / "trajectory.dump")
    assert len(found) >= 5
    steps = np.diff([frame.step for frame in found])
    assert steps.min() == steps.max() > 0
    for frame in found:
        grains = frame.columns
        assert set(grains) == {"id", "type", "radius", "x", "y", "z", "vx", "vy", "vz"}
        assert grains["id"] == sorted(set(grains["id"]))
        assert set(grains["radius"]) == {scene.grains.diameter / 2.0}
        (left, right), (front, back), _ = frame.bounds
        assert (right - left, back - front) == pytest.approx(
            (scene.tank.length, scene.tank.thickness)
        )
        out = max(left - min(grains["x"]), max(grains["x"]) - right)
        assert out < 0.1 * scene.grains.diameter  # engines wrap grains when they list pairs anew
    driven = [
        v
        for v, kind in zip(found[-1].columns["vx"], found[-1].columns["type"], strict=True)
        if kind == 2
    ]
    assert set(driven) == {scene.drive.speed}


def test_vtk_holds_the_frames_of_the_dump(folder: Path):
    expected = frames(folder / "trajectory.dump")
    reader = pyvista.get_reader(write_vtk(folder))
    step = Record.read(folder).plan.time_step
    assert reader.time_values == pytest.approx([frame.step * step for frame in expected])
    assert len(list((folder / "grains").iterdir())) == len(expected)
    for number, frame in enumerate(expected):
        reader.set_active_time_point(number)
        (grains,) = reader.read()
        known = {name: np.array(values) for name, values in frame.columns.items()}
        places = np.column_stack([known[axis] for axis in "xyz"])
        speeds = np.column_stack([known[f"v{axis}"] for axis in "xyz"])
        np.testing.assert_allclose(grains.points, places, rtol=1e-6, atol=0.0)
        np.testing.assert_allclose(grains["velocity"], speeds, rtol=1e-6, atol=1e-30)
        np.testing.assert_allclose(grains["diameter"], 2.0 * known["radius"], rtol=1e-6)
        np.testing.assert_array_equal(grains["id"], known["id"])
        np.testing.assert_array_equal(grains["type"], known["type"])


def test_vtk_has_the_cylinder(folder: Path):
    scene = CASE.scene
    assert isinstance(scene, TankScene)
    write_vtk(folder)
    left, right, front, back, low, high = pyvista.read(folder / "cylinder.vtp").bounds
    radius = scene.intruder.diameter / 2.0
    assert (front, back) == pytest.approx((0.0, scene.tank.thickness), abs=1e-9)
    assert (left, right) == pytest.approx((scene.axis_x - radius, scene.axis_x + radius), rel=1e-3)
    assert (low + high) / 2.0 == pytest.approx(scene.axis_height, rel=1e-6)


def said(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: object
) -> tuple[int, str, str]:
    monkeypatch.setattr("sys.argv", ["liftdrag", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0), *capsys.readouterr()


def test_a_run_says_what_opens_its_dump(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "tiny.toml").write_text(TINY)
    out, shorter = tmp_path / "out", "drive.distance='4 D'"
    words = ("run", tmp_path / "tiny.toml", "--set", shorter, "--dump", "--out", out)
    status, answer, _ = said(capsys, monkeypatch, *words)
    assert status == 0
    dump = f"OVITO opens {out}/trajectory.dump."
    assert answer.splitlines()[-1] == f"{dump} ParaView opens {out}/grains.pvd."
    assert (out / "grains.pvd").exists()
    monkeypatch.setattr(trajectory, "find_spec", lambda _name: None)
    how = "pip install 'liftdrag[vtk]'"
    assert trajectory.offer(out) == f"{dump} For ParaView: {how}, then liftdrag vtk {out}"
    status, _, wrong = said(capsys, monkeypatch, "vtk", out)
    assert status == 2
    assert wrong == f"VTK files are written by pyvista, which is not installed: {how}.\n"


def test_what_is_no_trajectory_is_refused(folder: Path, tmp_path: Path):
    shutil.copy(folder / "run.json", tmp_path)
    with pytest.raises(InputError, match=r"holds no trajectory.dump; run a tank or a shear flow"):
        write_vtk(tmp_path)
    (tmp_path / "trajectory.dump").write_bytes(b"")
    with pytest.raises(InputError, match=r"holds no whole frame; run the case again\.$"):
        write_vtk(tmp_path)
    rows = [line.split() for line in (folder / "trajectory.dump").read_text().splitlines()]
    without = [" ".join(row[:2] + row[3:] if len(row) == 9 else row) for row in rows]
    (tmp_path / "trajectory.dump").write_text("\n".join([*without, ""]).replace(" radius", ""))
    with pytest.raises(InputError, match=r"8 columns, not id type radius x y z vx vy vz"):
        write_vtk(tmp_path)
