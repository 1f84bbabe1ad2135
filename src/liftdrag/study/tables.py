"""The tables of a study: a row for each point and quantity, and one for each run and quantity.

CSV always; Parquet too where pyarrow is installed (`pip install 'liftdrag[parquet]'`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from liftdrag.analysis.claims import Finding
from liftdrag.analysis.quantity import Quantity
from liftdrag.scene import TankScene
from liftdrag.study.carried import Answer
from liftdrag.study.findings import Grown
from liftdrag.study.plan import Claim, Plan
from liftdrag.study.points import Point
from liftdrag.study.state import State
from liftdrag.study.tasks import Task

if TYPE_CHECKING:
    import pandas as pd

POINTS, RUNS_TABLE, CLAIMS, SATURATIONS = "points", "runs", "claims", "saturations"


def write_tables(
    folder: Path,
    plan: Plan,
    results: Mapping[str, Answer],
    found: Iterable[tuple[Claim, Finding]],
    grown: Iterable[Grown] = (),
) -> None:
    """`points`, `runs`, `claims` and `saturations`. Raises OSError."""
    import pandas as pd

    keys = varied_keys(plan, results.values())
    points = [row for one in results.values() for row in point_rows(one, keys)]
    _write(pd.DataFrame(points), folder / POINTS)
    runs = [row for one in results.values() for row in run_rows(one, keys)]
    _write(pd.DataFrame(runs), folder / RUNS_TABLE)
    claims = [
        {"claim": claim.says, "quantity": claim.quantity} | vars(finding)
        for claim, finding in found
    ]
    pd.DataFrame(claims).to_csv(folder / f"{CLAIMS}.csv", index=False)
    plateaus = [
        one.growth.model_dump()
        | vars(one.saturation)
        | {"finished": one.finished, "points": one.points}
        for one in grown
    ]
    if plateaus:
        pd.DataFrame(plateaus).to_csv(folder / f"{SATURATIONS}.csv", index=False)


def _write(table: pd.DataFrame, path: Path) -> None:
    table.to_csv(path.with_suffix(".csv"), index=False)
    if find_spec("pyarrow"):
        for name in table:
            if table[name].dtype == object:
                table[name] = table[name].map(str, na_action="ignore")
        table.to_parquet(path.with_suffix(".parquet"), index=False)


def varied_keys(plan: Plan, results: Iterable[Answer]) -> list[str]:
    """The keys of the cases in which the points of a study may differ."""
    own = [key for run in plan.runs.values() for key in run.set if key != "seed"]
    return list(dict.fromkeys([*own, *(key for one in results for key in one.point.varied)]))


def point_rows(one: Answer, keys: Iterable[str]) -> Iterator[dict[str, Any]]:
    """A row for each quantity of a point, or one that says why there is none."""
    reasons = dict.fromkeys(state.reason for _, state in one.runs if state.reason)
    head = {
        "point": one.point.name,
        "run": one.point.run,
        "status": one.status,
        "reason": "; ".join(reasons),
        "folder": " ".join(state.folder.name for _, state in one.runs if state.folder),
        "finished": one.replicas[0],
        "replicas": one.replicas[1],
        **_values(one.point, keys),
        **context(one.point, one.quantities),
    }
    yield from _rows(head, one.quantities)


def run_rows(one: Answer, keys: Iterable[str]) -> Iterator[dict[str, Any]]:
    """The same of each run of a point by itself, with what it took in seconds."""
    for task, state in one.runs:
        head = {
            "run": task.name,
            "point": one.point.name,
            "seed": task.case.tables["seed"],
            "status": state.status,
            "reason": state.reason,
            "folder": state.folder.name if state.folder else "",
            **_values(one.point, keys),
            **context(one.point, state.quantities),
            **_cost(task, state),
        }
        yield from _rows(head, state.quantities)


def _rows(head: dict[str, Any], found: Mapping[str, Quantity]) -> Iterator[dict[str, Any]]:
    if not found:
        yield head
    for name, quantity in found.items():
        yield head | {"quantity": name} | asdict(quantity)


def _values(point: Point, keys: Iterable[str]) -> dict[str, Any]:
    """What the point has at the keys, SI units where it is a number."""
    return {key: _plain(point.value(key)) for key in keys}


def _plain(value: Any) -> Any:
    return value if isinstance(value, bool | int | float | str | None) else str(value)


def _cost(task: Task, state: State) -> dict[str, Any]:
    record = state.record
    return {
        "engine": task.engine,
        "cpu_s": record.get("cpu_s"),
        "wall_s": record.get("wall_s"),
        "stopped_by": record.get("stopped_by"),
        "warnings": len(record["warnings"]) if "warnings" in record else None,
    }


def context(point: Point, found: Mapping[str, Quantity]) -> dict[str, Any]:
    """The dimensionless numbers that a tank's forces must be read with, and its speed U0 (m/s)."""
    scene = point.case.scene
    if not isinstance(scene, TankScene):
        return {}
    big, small = scene.intruder.diameter, scene.grains.diameter
    mean = {name: quantity.mean for name, quantity in found.items()}
    depth = mean.get("effective_depth")
    return {
        "length/D": scene.tank.length / big,
        "thickness/d": scene.tank.thickness / small,
        "D/d": big / small,
        "effective_depth/D": None if depth is None else depth / big,
        "U0 (m/s)": scene.drive.speed,
        "inertial_number": mean.get("inertial_number"),
        "bed_speed_ratio": mean.get("bed_speed_ratio"),
    }
