"""Scene, numerics and packed bed of a tank into its LAMMPS deck."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import StringIO
from math import ceil
from typing import Any

import numpy as np

from liftdrag import granular
from liftdrag.classic import Classic, classic
from liftdrag.deck.commands import check_commands
from liftdrag.deck.dialect import LAMMPS, LIGGGHTS, Contact, Dialect
from liftdrag.deck.model import Deck, Plan
from liftdrag.deck.restart import LongRun, deck_of, way_of
from liftdrag.deck.template import render
from liftdrag.errors import CaseError
from liftdrag.granular import GRAVITY
from liftdrag.numerics.tank import STEP_BOUND, TankNumerics, impact_speed
from liftdrag.packing import Container, random_bed, square_layer
from liftdrag.scene import TankScene
from liftdrag.scene.tank import FLOOR

START = "in.tank"

FLOOR_FORCES = {"floor_drag": "N", "floor_lift": "N"}
"""Force of the bed on the driven layers along x, and on the bottom layer along z."""

PIECES = 200
"""Pieces of a run of LIGGGHTS, after each of which it may end early."""


@dataclass(frozen=True)
class Bed:
    """Where grains are: `positions` (n, 3) in m; `types` (n,): grains 1, bottom layer 2, lid 3.

    A `settled` bed has been at rest under its load, another is as packed.
    """

    positions: np.ndarray
    types: np.ndarray
    settled: bool = False


def build(
    scene: TankScene,
    numerics: TankNumerics,
    name: str,
    version: str,
    ranks: int = 1,
    dump: bool = False,
    dialect: Dialect = LAMMPS,
    bed: Bed | None = None,
) -> Deck:
    """The deck of a tank; `dump` adds a trajectory. Without a `bed` one is packed.

    Raises InputError when packing fails, CaseError when the dialect cannot say the case.
    """
    _check_skin(scene, numerics, dialect)
    bed = bed or packed(scene)
    context = _context(scene, numerics, dialect) | {
        "program": dialect.program,
        "name": re.sub(r"[^A-Za-z0-9_./-]", "_", name)[:80],
        "version": version,
        "ranks": ranks,
        "settled": bed.settled,
        "stoppable": scene.stop is not None,
        "trajectory_every": numerics.trajectory_every.value if dump else 0,
        "fields_every": numerics.fields_every.value if numerics.fields_every else 0,
    }
    runs = _runs(scene, numerics, dialect)
    texts = dict(_decks(context, dialect, runs)) | {"grains.data": _data_file(scene, bed)}
    if scene.stop and dialect is LIGGGHTS:
        texts["stop.lmp"] = "variable good_enough equal 0\n"
    return Deck(texts, _plan(scene, numerics, ranks))


def _decks(
    context: dict[str, Any], dialect: Dialect, runs: Sequence[LongRun]
) -> Iterator[tuple[str, str]]:
    """The deck, and one for each stage that may be gone on with."""
    resumed = [(run.stage, deck_of(START, run.stage)) for run in runs if run.every]
    for stage, name in (("start", START), *resumed):
        going = {f"{run.stage}_run": run.lines(run.stage == stage) for run in runs}
        append = " append yes" if stage == "drive" else ""
        going |= {"stage": stage, "deck": name, "append": append}
        text = render(f"{dialect.folder}/tank.in.j2", context | going)
        check_commands(text, name)
        yield name, text


def _runs(scene: TankScene, numerics: TankNumerics, dialect: Dialect) -> tuple[LongRun, LongRun]:
    """The two stages, with restart files where they may take long enough for one."""
    every, way = numerics.restart_every.value, way_of(dialect)
    settle, drive = numerics.settle_steps_max.value, numerics.drive_steps.value
    if dialect is LIGGGHTS:
        return _written(scene, numerics, every)
    enough = "${good_enough} < 0.5" if scene.stop else ""
    return (
        LongRun("settle", f"{settle}", every * (every < settle), way, "${restless} > 0.5"),
        LongRun("drive", "${drive_steps}", every * (every < drive), way, enough),
    )


def _written(scene: TankScene, numerics: TankNumerics, every: int) -> tuple[LongRun, LongRun]:
    """Those of LIGGGHTS, which is looked at, and has its state written, after a piece."""
    settle, look = numerics.settle_steps_max.value, numerics.look_every.value
    drive = numerics.drive_steps.value
    settling = LongRun(
        "settle",
        f"{settle}",
        _whole(every, look) * (every < settle),
        "written",
        "${more} > 0.5",
        piece=look,
        after="variable     more equal ${restless}",
        kept_last=False,
    )
    if scene.stop is None:
        return settling, LongRun("drive", "${drive_steps}", every * (every < drive), "written")
    piece = _stop_piece(numerics)
    stopped = LongRun(
        "drive",
        "${drive_steps}",
        _whole(every, piece) * (every < drive),
        "written",
        "${good_enough} == 0",
        piece=piece,
        after="include      stop.lmp",
        joined=True,
    )
    return settling, stopped


def _whole(steps: int, piece: int) -> int:
    return piece * ceil(steps / piece)


def _plan(scene: TankScene, numerics: TankNumerics, ranks: int) -> Plan:
    return Plan(
        start=START,
        ranks=ranks,
        time_step=numerics.time_step.value,
        stages={
            "settle": numerics.settle_steps_max.value,
            "drive": numerics.drive_steps.value,
        },
        row_every=numerics.row_every.value,
        series={
            "forces.dat": {"drag": "N", "lift": "N"} | FLOOR_FORCES,
            "bed.dat": {"bed_speed": "m/s", "solid_fraction": "1", "overburden": "Pa"},
        },
        stoppable=scene.stop is not None,
    )


def _stop_piece(numerics: TankNumerics) -> int:
    """Steps, whole rows, after which LIGGGHTS may end."""
    drive, row = numerics.drive_steps.value, numerics.row_every.value
    return min(row * max(drive // (PIECES * row), 1), drive)


def packed(scene: TankScene) -> Bed:
    """The bed of a scene, packed at random. Raises InputError when its grains do not fit."""
    d, box = scene.grains.diameter, scene.tank
    length, thickness, height = box.length / d, box.thickness / d, scene.packed_height / d
    bottom = square_layer(length, thickness, 0.5)
    container = Container(
        length=length,
        thickness=thickness,
        bottom=FLOOR,
        top=height,
        axis=(scene.axis_x / d, scene.axis_height / d),
        radius=scene.intruder.diameter / d / 2.0,
        floor=bottom,
    )
    grains = random_bed(container, scene.grain_count, np.random.default_rng(scene.seed))
    layers = [grains, bottom]
    if scene.lid is not None:
        layers.append(square_layer(length, thickness, height + 0.5))
    types = np.repeat(np.arange(1, len(layers) + 1), [len(layer) for layer in layers])
    return Bed(np.concatenate(layers) * d, types)


def _headroom(scene: TankScene) -> float:
    return scene.packed_height + 10.0 * scene.grains.diameter + 3.0 * scene.intruder.diameter


def _data_file(scene: TankScene, bed: Bed) -> str:
    grains, box, types = scene.grains, scene.tank, bed.types
    made = "settled" if bed.settled else "packed"
    density = np.full(len(types), grains.density)
    if scene.lid is not None:
        density[types == 3] *= scene.lid.density_ratio
    out = StringIO()
    out.write(f"Grains {made} by liftdrag: id type diameter density x y z\n\n")
    out.write(f"{len(types)} atoms\n{types.max()} atom types\n")
    out.write(f"0 {box.length:.12g} xlo xhi\n0 {box.thickness:.12g} ylo yhi\n")
    out.write(f"0 {_headroom(scene):.12g} zlo zhi\n\nAtoms\n\n")
    rows = np.column_stack(
        [np.arange(1, len(types) + 1), types, np.full(len(types), grains.diameter), density]
    )
    np.savetxt(
        out, np.column_stack([rows, bed.positions]), fmt="%d %d %.12g %.12g %.15g %.15g %.15g"
    )
    return out.getvalue()


def _context(scene: TankScene, numerics: TankNumerics, dialect: Dialect) -> dict[str, Any]:
    law = dialect.numbers(contact_of(scene), 2 if scene.lid is None else 3)
    context = law | _bounds(dialect, numerics) | _loads(scene)
    context |= _geometry(scene) | _far_field(scene) | _steps(numerics)
    return {key: _plain(value) for key, value in context.items()} | {"seed": scene.seed}


def _plain(value: Any) -> Any:
    return f"{value:.10g}" if isinstance(value, float) and value else value


def contact_of(scene: TankScene) -> Contact:
    """The contacts of the grains with each other and with the cylinder."""
    grains = scene.grains
    return Contact(
        youngs_modulus=grains.youngs_modulus,
        poisson_ratio=grains.poisson_ratio,
        restitution=grains.restitution,
        friction=grains.friction,
        radius=grains.diameter / 2.0,
        wall_radius=scene.intruder.diameter / 2.0,
        classic=_classic(scene) if scene.numerics.pair_law == "hertz/history" else None,
    )


def _classic(scene: TankScene) -> Classic:
    grains, speed = scene.grains, impact_speed(scene)
    radius, mass = grains.diameter / 4.0, grains.mass / 2.0
    return classic(grains.restitution, grains.stiffness, radius, mass, speed)


def _bounds(dialect: Dialect, numerics: TankNumerics) -> dict[str, Any]:
    """The largest step that LIGGGHTS lets through, over the Rayleigh and the Hertz time.

    It takes twice the speed of the fastest grain for an impact: twice the Hertz time's share
    lets grains fly at some ten times the drive's speed.
    """
    if dialect is not LIGGGHTS:
        return {}
    step = numerics.time_step.value
    return {
        "rayleigh_bound": max(STEP_BOUND, 1.01 * step / numerics.rayleigh_time.value),
        "hertz_bound": 2.0 * max(STEP_BOUND, 1.01 * step / numerics.hertz_time.value),
    }


def _check_skin(scene: TankScene, numerics: TankNumerics, dialect: Dialect) -> None:
    """LIGGGHTS stops when two grains at the drive's speed could meet within the skin in a step."""
    step, skin = numerics.time_step.value, numerics.skin.value
    if dialect is LIGGGHTS and 2.5 * scene.drive.speed * step > skin:
        raise CaseError(
            "drive.speed",
            scene.drive.speed,
            f"grains cross the skin, {skin:.3g} m, in a step of {step:.3g} s, where LIGGGHTS stops",
            f"drive at most at {skin / (2.5 * step):.3g} m/s, or choose another engine",
        )


def _loads(scene: TankScene) -> dict[str, Any]:
    return {
        "bulk_gravity": scene.bulk_gravity,
        "lid": scene.lid is not None,
        "lid_gravity": GRAVITY,
        "lid_ratio": 1.0 if scene.lid is None else scene.lid.density_ratio,
    }


def _geometry(scene: TankScene) -> dict[str, Any]:
    return {
        "axis_x": scene.axis_x,
        "axis_z": scene.axis_height,
        "cylinder_radius": scene.intruder.diameter / 2.0,
        "drive_speed": scene.drive.speed,
        "rolls": scene.grains.friction > 0.0,
    }


def _far_field(scene: TankScene) -> dict[str, Any]:
    """The far field about the cylinder's height, clear of the surface and the bottom layer."""
    grains, box = scene.grains, scene.tank
    d, (left, right) = grains.diameter, scene.far_field
    length, (low, high) = right - left, scene.far_band
    lid_weight = 0.0
    if scene.lid is not None:
        layer = len(square_layer(box.length / d, box.thickness / d, 0.0))
        lid_mass = scene.lid.density_ratio * grains.mass
        lid_weight = layer * lid_mass * GRAVITY / (box.length * box.thickness)
    return {
        "far_left": left,
        "far_right": right,
        "far_low": low,
        "far_high": high,
        "far_volume": length * box.thickness * (high - low),
        "far_area": length * box.thickness,
        "grain_volume": granular.sphere_volume(d),
        "grain_weight": grains.mass * scene.bulk_gravity,
        "lid_pressure": lid_weight,
    }


def _steps(numerics: TankNumerics) -> dict[str, Any]:
    x, y, z = numerics.processors.value
    names = (
        "time_step settle_damping settle_energy settle_steps settle_steps_max drive_steps "
        "sample_every row_every snapshot_every surface_every progress_every skin sort_every "
        "look_every"
    ).split()
    values = {name: getattr(numerics, name).value for name in names}
    return values | {
        "samples": numerics.row_every.value // numerics.sample_every.value,
        "processors": f"{x} {y} {z}",
    }
