"""What a bench found: its runs, and all that follows from them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from liftdrag.analysis.biases import Biases
from liftdrag.bench.axes import Axis
from liftdrag.bench.block import block
from liftdrag.bench.judged import Judged, Key, best, biases, costs, judge
from liftdrag.bench.recommendation import Advice, advise
from liftdrag.bench.runs import Run, Stand
from liftdrag.case import Case


@dataclass(frozen=True)
class Benched:
    """A case benched: on what, its axes, the tolerance of each quantity, and the runs that ended.

    `notes` say which values the scene refuses, `left` what the budget was too short for.
    """

    case: Case
    stand: Stand
    axes: tuple[Axis, ...]
    tolerances: Mapping[str, float]
    runs: tuple[Run, ...]
    notes: Sequence[str] = ()
    left: Sequence[str] = ()

    @property
    def keys(self) -> list[Key]:
        """The points with a run that ended, the case first, then by axis and value."""
        order = [(axis.name, setting.name) for axis in self.axes for setting in axis.settings]
        known = {one.key for one in self.runs}
        return sorted(known, key=lambda key: order.index(key) if key in order else -1)

    def judged(self, quantity: str) -> dict[Key, Judged]:
        """What the points say of a quantity."""
        return judge(self.runs, quantity)

    @property
    def biases(self) -> Biases:
        """The case against more careful choices."""
        found = biases(self.runs, self.axes, tuple(self.tolerances))
        return Biases(self.case.name, self.stand.engine, dict(self.case.tables), found)

    @property
    def advice(self) -> list[Advice]:
        """What is recommended of each axis that was measured."""
        return advise(self.runs, self.axes, self.tolerances)

    def block(self) -> str:
        """The recommended table `[numerics]`."""
        title = f"Recommended by liftdrag bench of {self.case.name} on the engine "
        given = dict(self.case.tables.get("numerics", {}))
        return block(title + self.stand.engine, self.advice, given)

    def rows(self) -> Iterator[dict[str, Any]]:
        """A row for each point and quantity; of one that failed a single row."""
        judged = {name: self.judged(name) for name in self.tolerances}
        fronts = {name: best(self.runs, name) for name in self.tolerances}
        for key in self.keys:
            common = self._common(key)
            names = [name for name in judged if key in judged[name]]
            for name in names:
                front = {"front": key in fronts[name]}
                yield common | {"quantity": name} | _columns(judged[name][key]) | front
            if not names:
                yield common

    def _common(self, key: Key) -> dict[str, Any]:
        mine = [one for one in self.runs if one.key == key]
        done = [one for one in mine if one.finished]
        failed = next((one for one in mine if not one.finished), None)
        spent = costs(mine).get(key)
        return {
            "axis": key[0],
            "value": key[1],
            "key": next((axis.key for axis in self.axes if axis.name == key[0]), ""),
            "at": self._at(key),
            "runs": len(done),
            "status": failed.status if failed else "finished",
            "reason": failed.reason if failed else "",
            "cpu_s": spent.cpu_s if spent else None,
            "grain_steps": sum(one.grain_steps for one in done),
            "grain_steps_per_s": sum(one.grain_steps_per_s for one in done) / max(len(done), 1),
        }

    def _at(self, key: Key) -> float | str | None:
        for axis in self.axes:
            for setting in axis.settings:
                if (axis.name, setting.name) == key:
                    return setting.at
        return None

    def to_dict(self) -> dict[str, Any]:
        """All of it, as `bench.json` holds it."""
        return self.biases.to_dict() | {
            "scene": self.case.scene.scene,
            "engine_version": self.stand.version,
            "tolerances": dict(self.tolerances),
            "points": list(self.rows()),
            "runs": [one.to_dict() for one in self.runs],
            "recommended": [_advised(one) for one in self.advice],
            "notes": list(self.notes),
            "left_out": list(self.left),
        }


def _columns(judged: Judged) -> dict[str, Any]:
    return {
        "unit": judged.answer.unit,
        "mean": judged.answer.mean,
        "standard_error": judged.answer.standard_error,
        "converged": judged.answer.converged,
        "deviation": judged.deviation.relative,
        "deviation_error": judged.deviation.standard_error,
        "total_error": judged.total_error,
    }


def _advised(advice: Advice) -> dict[str, Any]:
    setting = advice.setting
    return {
        "axis": advice.axis.name,
        "key": advice.axis.key,
        "value": None if setting is None else setting.at,
        "evidence": advice.evidence,
        "cheaper": list(advice.cheaper),
    }
