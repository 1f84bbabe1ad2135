"""Scene, numerics and packed column of a Janssen piston into a deck of LAMMPS or LIGGGHTS."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from io import StringIO
from math import ceil, sqrt
from typing import Any

import numpy as np

from liftdrag import granular
from liftdrag.deck.commands import check_commands
from liftdrag.deck.dialect import IN_HOUSE, LAMMPS_2021, LIGGGHTS, Contact, Dialect
from liftdrag.deck.model import Deck, Plan
from liftdrag.deck.restart import LongRun, Way, deck_of, restarting, way_of
from liftdrag.deck.template import render
from liftdrag.errors import CaseError
from liftdrag.granular import GRAVITY
from liftdrag.numerics import JanssenNumerics
from liftdrag.packing.tube import PackedColumn
from liftdrag.profile import SLIDING
from liftdrag.scene import JanssenScene
from liftdrag.scene.janssen import TANGENTIAL_RATIO

START = "in.janssen"

CHANNELS = {"piston": "N", "tube": "N", "wall_normal": "N", "kinetic": "J"}
"""The downward force on the piston, what the tube lifts and bears, the grains' mean energy."""

GRAIN, LID, TUBE, PISTON = 1, 2, 3, 4
"""The types: of grains, of the lid's, and of the walls."""

TYPES = 4

LARGEST_STEP = 0.2
"""Time step over the smaller of the Rayleigh and Hertz times at which LIGGGHTS stops, unless a
larger one is asked for."""

LID_MOTION = "fix          lid_motion lid rigid single force 1 off off on torque 1 off off off"

DILATION = 0.1
"""How much higher than as packed a column may become, of its height."""


def build(
    scene: JanssenScene,
    numerics: JanssenNumerics,
    column: PackedColumn,
    name: str,
    version: str,
    ranks: int,
    dialect: Dialect,
) -> Deck:
    """The deck of a column that is filled level by level.

    Raises CaseError when the dialect cannot say the contacts.
    """
    check_contact(scene, dialect)
    context = _context(scene, numerics, column, dialect) | {
        "program": dialect.program,
        "name": re.sub(r"[^A-Za-z0-9_./-]", "_", name)[:80],
        "version": version,
        "ranks": ranks,
    }
    texts = dict(_decks(context, dialect)) | {"column.data": _data_file(scene, numerics, column)}
    if scene.stop and dialect is LIGGGHTS:
        numbers = range(1, len(numerics.levels) + 1)
        texts |= {f"stop-{number}.lmp": "variable good_enough equal 0\n" for number in numbers}
    return Deck(texts, plan_of(scene, numerics, ranks, START, {"forces.dat": CHANNELS}))


def _decks(context: dict[str, Any], dialect: Dialect) -> Iterator[tuple[str, str]]:
    """The deck, and the one that goes on with it."""
    names = {START: False} | ({deck_of(START, "drive"): True} if context["kept"] else {})
    for name, resumed in names.items():
        own = {"deck": name, "resumed": resumed}
        text = render(f"{dialect.folder}/janssen.in.j2", context | own)
        check_commands(text, name)
        yield name, text


def check_contact(scene: JanssenScene, dialect: Dialect) -> None:
    """Raise CaseError for a contact law that the dialect does not know."""
    contact = scene.grains.contact
    if contact == "walton-braun" and dialect is not IN_HOUSE:
        raise CaseError(
            "grains.contact",
            contact,
            f"{dialect.name} has no Walton-Braun contact",
            'choose --engine dem, or grains.contact = "linear"',
        )
    if contact == "hertz" and dialect is LAMMPS_2021:
        raise CaseError(
            "grains.contact",
            contact,
            f"{dialect.name} damps Hertz walls differently at each run of a deck",
            'choose another --engine, or grains.contact = "linear"',
        )
    if contact == "hertz":
        dialect.numbers(contact_of(scene, 1.0), TYPES)


def plan_of(
    scene: JanssenScene,
    numerics: JanssenNumerics,
    ranks: int,
    start: str,
    series: Mapping[str, Mapping[str, str]],
) -> Plan:
    """What the deck of a column promises: all fills in one stage, and the files of its series."""
    levels = numerics.levels
    return Plan(
        start=start,
        ranks=ranks,
        time_step=numerics.time_step.value,
        stages={"drive": levels[-1].end},
        row_every=numerics.row_every.value,
        series=series,
        fills=[(level.count, level.start, level.mobilised, level.end) for level in levels],
        stoppable=scene.stop is not None,
    )


def _context(
    scene: JanssenScene, numerics: JanssenNumerics, column: PackedColumn, dialect: Dialect
) -> dict[str, Any]:
    law = _linear if scene.grains.contact == "linear" else _hertz
    context = law(scene, numerics.stiffness.value, dialect)
    context |= _set_up(scene, numerics, column) | _steps(numerics) | _bounds(numerics)
    words = {key: _plain(value) for key, value in context.items()} | {"seed": scene.seed}
    words |= {"stoppable": scene.stop is not None, "averaging": f"{dialect.folder}/average.j2"}
    way = way_of(dialect, springs=scene.grains.contact == "linear")
    words |= _keeping(numerics, way)
    runs = _Runs(words["kept"], way, numerics, scene.stop is not None)
    fills = [render("fill.j2", words | fill | runs.of(fill)) for fill in _fills(numerics)]
    return words | {"fills": "".join(fills)}


def _keeping(numerics: JanssenNumerics, way: Way) -> dict[str, Any]:
    """Every how many steps the state is kept, 0 for never, and the command for it, if any."""
    every = numerics.restart_every.value
    kept = every if every < numerics.levels[-1].end else 0
    asked = kept and way != "written"
    return {"kept": kept, "restarting": restarting("drive", every) if asked else ""}


@dataclass(frozen=True)
class _Runs:
    """The runs of the fills: as they are, or `kept` every so many steps in an engine's way."""

    kept: int
    way: Way
    numerics: JanssenNumerics
    stoppable: bool

    def of(self, fill: Mapping[str, int]) -> dict[str, str]:
        """Those of a fill, by the names that its template gives them."""
        return {f"{phase}_run": self._run(phase, fill) for phase in _LABELS}

    def _run(self, phase: str, fill: Mapping[str, int]) -> str:
        if not self.kept:
            return f"run          {fill[phase]}{_NOTES[phase] * (not self._is_watched(phase))}"
        run = LongRun(
            "drive",
            "${until}",
            self.kept,
            self.way,
            label=f"{_LABELS[phase]}_{fill['number']}",
        )
        if self._is_watched(phase):
            run = self._until_enough(run, fill["number"])
        return run.body(resumed=True)

    def _is_watched(self, phase: str) -> bool:
        return phase == "average" and self.stoppable

    def _until_enough(self, run: LongRun, number: int) -> LongRun:
        """An average that may end early; that of LIGGGHTS is looked at after each block."""
        going = replace(run, going="${good_enough} < 0.5")
        if self.way != "written":
            return going
        block, after = self.numerics.block_every.value, f"include      stop-{number}.lmp"
        return replace(going, piece=block, after=after)


def _plain(value: Any) -> Any:
    return f"{value:.15g}" if isinstance(value, float) and value else value


def _linear(scene: JanssenScene, stiffness: float, dialect: Dialect) -> dict[str, Any]:
    """Springs and dashpots; at a wall the effective mass is a grain's, between two the half."""
    grains = scene.grains
    pair = grains.dashpot(stiffness, grains.mass / 2.0)
    wall = grains.dashpot(stiffness, grains.mass)
    law = {
        "linear": True,
        "restitution": grains.restitution,
        "tube_friction": scene.tube.friction,
    }
    if dialect is LIGGGHTS:
        return law | _matrices(scene, stiffness, pair, wall)
    return law | {
        "stiffness": stiffness,
        "tangential_stiffness": TANGENTIAL_RATIO * stiffness,
        "tangential_damping": sqrt(TANGENTIAL_RATIO),
        "pair_damping": pair,
        "wall_damping": wall,
        "friction": grains.friction,
    }


def _matrices(scene: JanssenScene, stiffness: float, pair: float, wall: float) -> dict[str, Any]:
    """The law of the springs for each pair of types; what does not rub is not damped sideways."""
    normal, damping = np.full((TYPES, TYPES), stiffness), _of_pairs(pair, wall, wall)
    friction = _frictions(scene)
    sideways = np.where(friction > 0.0, sqrt(TANGENTIAL_RATIO) * damping, 0.0)
    return {
        "types": TYPES,
        "stiffnesses": _words(normal),
        "tangential_stiffnesses": _words(TANGENTIAL_RATIO * normal),
        "dampings": _words(damping),
        "tangential_dampings": _words(sideways),
        "frictions": _words(friction),
    }


def _hertz(scene: JanssenScene, modulus: float, dialect: Dialect) -> dict[str, Any]:
    """Hertz-Mindlin; the tube is a plane to the grains that touch it."""
    contact = contact_of(scene, modulus)
    tube = replace(contact, friction=scene.tube.friction, wall_radius=-scene.tube.diameter / 2.0)
    law, wall = dialect.numbers(contact, TYPES), dialect.numbers(tube, TYPES)
    context = law | {"linear": False, "tube_friction": scene.tube.friction}
    if dialect is LIGGGHTS:
        return context | {
            "frictions": _words(_frictions(scene)),
            "tube_tangential_damping": wall["tangential_damping"],
        }
    return context | {"tube_modulus": wall["wall_modulus"]}


def contact_of(scene: JanssenScene, modulus: float) -> Contact:
    """The contacts of Hertz between the grains, of a modulus in Pa."""
    grains = scene.grains
    return Contact(
        youngs_modulus=modulus,
        poisson_ratio=grains.poisson_ratio or 0.0,
        restitution=grains.restitution,
        friction=grains.friction,
        radius=grains.diameter / 2.0,
    )


def _frictions(scene: JanssenScene) -> np.ndarray:
    """The friction of each pair of types (4, 4)."""
    return _of_pairs(scene.grains.friction, scene.grains.friction, scene.tube.friction)


def _of_pairs(grains: float, piston: float, tube: float) -> np.ndarray:
    """A value for each pair of types (4, 4): among grains, with the piston, with the tube."""
    values = np.full((TYPES, TYPES), grains)
    values[PISTON - 1, :] = values[:, PISTON - 1] = piston
    values[TUBE - 1, :] = values[:, TUBE - 1] = tube
    return values


def _words(values: np.ndarray) -> str:
    return " ".join(f"{value:.15g}" for value in values.ravel())


_LABELS = {"settle": "settling", "mobilise": "mobilising", "average": "averaging"}
"""The phases of a fill, and what the pieces of their runs are called."""

_NOTES = {
    "settle": "",
    "mobilise": "                        # until the wall's friction is mobilised",
    "average": "                        # averaged",
}
"""What is said of the runs that are in one piece."""


def _set_up(scene: JanssenScene, numerics: JanssenNumerics, column: PackedColumn) -> dict[str, Any]:
    x, y, z = numerics.processors.value
    rate = numerics.settle_rate.value
    return {
        "lid": len(column.lid) > 0,
        "lid_motion": LID_MOTION,
        "diameter": scene.grains.diameter,
        "gravity": GRAVITY,
        "tube_radius": scene.tube.diameter / 2.0,
        "wall_speed": scene.wall_speed,
        "sliding": SLIDING,
        "settle_damping": rate * scene.grains.mass,
        "lid_settle_damping": rate * scene.lid_mass / max(len(column.lid), 1),
        "processors": f"{x} {y} {z}",
    }


def _steps(numerics: JanssenNumerics) -> dict[str, Any]:
    names = (
        "time_step sample_every row_every profile_every block_every progress_every bin_height skin"
    ).split()
    values = {name: getattr(numerics, name).value for name in names}
    return values | {
        "samples": values["row_every"] // values["sample_every"],
        "profiles": values["block_every"] // values["profile_every"],
        "first_count": numerics.levels[0].count,
        "filled": len(numerics.levels) > 1,
        "drive_steps": numerics.levels[-1].end,
    }


def _bounds(numerics: JanssenNumerics) -> dict[str, float]:
    """The largest step that LIGGGHTS lets through, over the Rayleigh and the Hertz time.

    It takes twice the speed of the fastest grain for an impact.
    """
    share = numerics.time_step.value / numerics.contact_time.value
    bound = max(LARGEST_STEP, 1.01 * share)
    return {"rayleigh_bound": bound, "hertz_bound": 2.0 * bound}


def _fills(numerics: JanssenNumerics) -> Iterator[dict[str, int]]:
    """Each level's first and last grain, its first and last step, and the steps of its phases."""
    first = 1
    for number, level in enumerate(numerics.levels, start=1):
        yield {
            "number": number,
            "added": number > 1,
            "first": first,
            "last": level.count,
            "start": level.start,
            "end": level.end,
            "steps": level.end - level.start,
            "settle": level.settled - level.start,
            "mobilise": level.mobilised - level.settled,
            "average": level.end - level.mobilised,
            "pieces": (level.end - level.mobilised) // numerics.block_every.value,
        }
        first = level.count + 1


def _data_file(scene: JanssenScene, numerics: JanssenNumerics, column: PackedColumn) -> str:
    """The grains in order, numbered from 1, and after them the lid's."""
    side, top = scene.tube.diameter / 2.0 + scene.grains.diameter, _top(scene, numerics, column)
    rows = _rows(scene, column)
    out = StringIO()
    out.write("Grains packed by liftdrag: id type diameter density x y z\n\n")
    out.write(f"{len(rows)} atoms\n{TYPES} atom types\n")
    out.write(f"{-side:.12g} {side:.12g} xlo xhi\n{-side:.12g} {side:.12g} ylo yhi\n")
    out.write(f"0 {top:.12g} zlo zhi\n\nAtoms\n\n")
    np.savetxt(out, rows, fmt="%d %d %.15g %.15g %.15g %.15g %.15g")
    return out.getvalue()


def _rows(scene: JanssenScene, column: PackedColumn) -> np.ndarray:
    grains, d = scene.grains, scene.grains.diameter
    own = scene.lid_mass / max(len(column.lid), 1) / granular.sphere_volume(d)
    kinds = np.repeat([GRAIN, LID], [len(column.grains), len(column.lid)])
    density = np.where(kinds == GRAIN, grains.density, own)
    ids = np.arange(1, len(kinds) + 1)
    centres = np.concatenate([column.grains, column.lid.reshape(-1, 3)])
    return np.column_stack([ids, kinds, np.full(len(kinds), d), density, centres])


def _top(scene: JanssenScene, numerics: JanssenNumerics, column: PackedColumn) -> float:
    """A height (m) that nothing reaches: each layer falls from one diameter above the last.

    A whole number of the profile's slices, so that none is cut.
    """
    packed = float(np.concatenate([column.grains, column.lid.reshape(-1, 3)])[:, 2].max())
    highest = (1.0 + DILATION) * packed + (len(numerics.levels) + 4.0) * scene.grains.diameter
    height = numerics.bin_height.value
    return ceil(highest / height) * height
