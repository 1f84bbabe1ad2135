"""The trajectory of a sheared cell: what OVITO and VTK are told, against the looks."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import pyvista
from test_shear_scene import tiny
from test_trajectory import frames

from liftdrag.engines.dem_shear import snapshots
from liftdrag.errors import InputError
from liftdrag.runner import run
from liftdrag.scene import ShearScene
from liftdrag.trajectory import cells, write_vtk

CASE = tiny()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(CASE, tmp_path_factory.mktemp("cell"), dump=True).folder


@pytest.fixture(scope="module")
def sides() -> np.ndarray:
    """Diameter and length (m) of each grain (n, 2), from the species."""
    scene = CASE.scene
    assert isinstance(scene, ShearScene)
    each = [one.sides(scene.grains.diameter) for one in scene.species]
    return np.repeat(each, scene.counts, axis=0)


def turned(turn: np.ndarray) -> np.ndarray:
    """Where quaternions (n, 4), i j k w, take z: the last column of their rotation matrices."""
    i, j, k, w = turn.T
    return np.column_stack([2 * (i * k + j * w), 2 * (j * k - i * w), 1 - 2 * (i * i + j * j)])


def test_ovito_is_told_axis_and_sides(folder: Path, sides: np.ndarray):
    seen, told = list(snapshots(folder)), frames(folder / "trajectory.dump", "pp pp pp")
    assert len(told) == min(len(seen), cells.MOST)
    for moment, frame in ((seen[0], told[0]), (seen[-1], told[-1])):
        known = {name: np.array(values) for name, values in frame.columns.items()}
        turn = np.column_stack([known[f"quat{letter}"] for letter in "ijkw"])
        assert moment.axis is not None
        np.testing.assert_allclose(turned(turn), moment.axis, atol=2e-6)
        np.testing.assert_allclose(np.linalg.norm(turn, axis=1), 1.0, atol=2e-6)
        np.testing.assert_allclose(known["shapex"], sides[:, 0], rtol=1e-6)
        np.testing.assert_allclose(known["shapez"] / 2.0, sides[:, 1], rtol=1e-6)
        places = np.column_stack([known[name] for name in "xyz"])
        np.testing.assert_allclose(places, moment.position, rtol=1e-6)


def test_axes_against_z_are_turned_too():
    axis = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1e-5, 0.0, -1.0], [0.6, 0.0, 0.8]])
    assert turned(cells.turn_of(axis)) == pytest.approx(axis, abs=2e-5)


def test_surfaces_are_closed_prisms_about_each_grain(folder: Path, sides: np.ndarray):
    """Each holds the volume of a polygon's prism, 2.6 % less than the cylinder about it."""
    reader = pyvista.get_reader(write_vtk(folder))
    (surface,) = reader.read()
    first = next(snapshots(folder))
    area = 0.5 * cells.CORNERS * np.sin(2.0 * np.pi / cells.CORNERS) * 0.25 * sides[:, 0] ** 2
    assert surface.n_open_edges == 0
    assert surface.triangulate().volume == pytest.approx((area * sides[:, 1]).sum(), rel=1e-4)
    corners = surface.points.reshape(len(sides), 2, cells.CORNERS, 3).astype(float)
    np.testing.assert_allclose(corners.mean(axis=(1, 2)), first.position, rtol=1e-4)
    along = corners[:, 1].mean(axis=1) - corners[:, 0].mean(axis=1)
    assert first.axis is not None
    np.testing.assert_allclose(along, first.axis * sides[:, 1, None], atol=1e-4 * sides.max())
    np.testing.assert_array_equal(surface["type"][:: 2 * cells.CORNERS], first.kind)


def test_spheres_among_cylinders_keep_their_size(tmp_path: Path):
    """In OVITO thrice the diameter; for VTK, points at their radius."""
    species = [{"shape": "sphere", "share": 0.5}, {"aspect_ratio": 2, "share": 0.5}]
    out = run(tiny(species=species), tmp_path / "run", dump=True).folder
    (frame, *_) = frames(out / "trajectory.dump", "pp pp pp")
    shape = np.column_stack([frame.columns[f"shape{axis}"] for axis in "xyz"])
    is_sphere = np.array(frame.columns["type"]) == 1
    scene = CASE.scene
    assert isinstance(scene, ShearScene)
    assert shape[is_sphere] == pytest.approx(scene.grains.diameter)
    (surface,) = pyvista.get_reader(write_vtk(out)).read()
    ball = surface["type"] == 1
    assert len(np.unique(surface["id"][ball])) == is_sphere.sum()
    middle = next(snapshots(out)).position[surface["id"][ball] - 1]
    from_middle = np.linalg.norm(surface.points[ball] - middle, axis=1)
    np.testing.assert_allclose(from_middle, 0.5 * scene.grains.diameter, rtol=1e-4)


def test_dump_is_made_anew_and_a_run_without_looks_has_not_ended(folder: Path, tmp_path: Path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    whole = (copy / "trajectory.dump").read_bytes()
    (copy / "trajectory.dump").write_bytes(b"")
    write_vtk(copy)
    assert (copy / "trajectory.dump").read_bytes() == whole
    (copy / "looks.npz").write_bytes((copy / "looks.npz").read_bytes()[:1000])
    with pytest.raises(InputError, match="looks at the cell are damaged"):
        write_vtk(copy)
    (copy / "looks.npz").unlink()
    with pytest.raises(InputError, match="has not ended; go on with: liftdrag run --resume --out"):
        write_vtk(copy)
    assert (copy / "trajectory.dump").read_bytes() == whole
