"""The fields of a tank with [fields]: read, averaged over the steady window, written and drawn."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from liftdrag.analysis import around
from liftdrag.analysis.around import FEWEST, Around
from liftdrag.analysis.fields import Fields
from liftdrag.analysis.ring import ANGLES, Ring
from liftdrag.analysis.tank import Answers
from liftdrag.deck import Plan
from liftdrag.engines.contact_dumps import force_snapshots
from liftdrag.errors import InputError
from liftdrag.pictures import fields as pictures
from liftdrag.scene import TankScene
from liftdrag.series import Series

FILES = ("fields.png", "streamlines.png", "asymmetry.png", "cylinder.png", "cylinder.csv")


def read(
    folder: Path, scene: TankScene, plan: Plan, series: Series, found: Answers
) -> Around | None:
    """From the dumps of a run; None where its case has no fields, or its steady window too few.

    Raises InputError when the dumps are damaged.
    """
    start, end = series.time[found.window.start], series.time[found.window.stop - 1]
    try:
        return around.around(scene, force_snapshots(plan, folder), start, end)
    except (OSError, ValueError) as error:
        raise InputError(
            f"The dumps of the fields in {folder} are damaged ({error}); run the case again."
        ) from error


def told(scene: TankScene, found: Answers, fields: Around | None) -> Answers:
    """The answers of a run and those of its fields."""
    if scene.fields is None:
        return found
    if fields is None:
        missing = f"No fields: fewer than {FEWEST} snapshots lie in the steady window; run longer."
        return replace(found, warnings=(*found.warnings, missing))
    more = around.quantities(scene, fields, found.quantities["overburden"])
    warnings = (*found.warnings, *around.warnings(fields, found.quantities))
    return replace(found, quantities=found.quantities | more, warnings=warnings)


def recorded(found: Answers, fields: Around | None) -> dict[str, Any]:
    """What `result.json` says of the snapshots beside their quantities."""
    if fields is None:
        return {}
    apart = around.apart(fields, found.quantities)
    return {"fields": {"snapshots": len(fields.forces), "errors_from_series": apart}}


def write(folder: Path, scene: TankScene, found: Answers, fields: Around | None) -> Iterator[str]:
    """Write tables and pictures into the folder; gives the names of those to look at."""
    if fields is None:
        return
    confining = found.quantities["overburden"].mean
    bulk = found.quantities["solid_fraction"].mean * scene.grains.density
    _write_ring(fields.ring, folder / "cylinder.csv")
    named: dict[str, Any] = dict(_columns(fields.fields))
    np.savez_compressed(
        folder / "fields.npz", x=fields.fields.grid.x, z=fields.fields.grid.z, **named
    )
    with contextlib.suppress(ImportError):
        _write_vti(fields.fields, named, folder / "fields.vti")
    pictures.draw_fields(scene, fields.fields, confining, folder / "fields.png")
    pictures.draw_streamlines(scene, fields.fields, folder / "streamlines.png")
    pictures.draw_asymmetry(
        scene, fields.fields, fields.ring, confining, bulk, folder / "asymmetry.png"
    )
    pictures.draw_ring(fields.ring, confining, folder / "cylinder.png")
    yield from FILES


def _columns(fields: Fields) -> Iterator[tuple[str, np.ndarray]]:
    """Each field and its error by name, (nx, nz), (nx, nz, 3) or (nx, nz, 3, 3)."""
    for name, (values, errors) in fields.named().items():
        yield name, values
        yield f"{name}_error", errors


def _write_ring(ring: Ring, file: Path) -> None:
    """The stress around the cylinder as CSV, in Pa, by the paper's angle: 0 in front, 90 below."""
    columns = [np.degrees(ANGLES), *ring.normal(), *ring.tangential()]
    head = "angle_degrees,normal,normal_error,tangential,tangential_error"
    np.savetxt(file, np.column_stack(columns), fmt="%.10g", delimiter=",", header=head, comments="")


def _write_vti(fields: Fields, named: Mapping[str, np.ndarray], file: Path) -> None:
    """The fields as VTK image data, for ParaView. Raises ImportError without pyvista."""
    import pyvista

    grid = fields.grid
    columns, levels = len(grid.x), len(grid.z)
    origin = (grid.x[0], 0.0, grid.z[0])
    image = pyvista.ImageData(
        dimensions=(columns, 1, levels), spacing=tuple(grid.step), origin=origin
    )
    for name, values in named.items():
        turned = np.swapaxes(values, 0, 1)
        image.point_data[name] = turned.reshape(columns * levels, -1)
    image.save(file)
