"""The folder of a bench: begun, and written whole at the end."""

from __future__ import annotations

import errno
from pathlib import Path

from liftdrag.analysis.biases import BENCH
from liftdrag.bench.benched import Benched
from liftdrag.bench.judged import Key, best, costs, judge
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import read_json, write_json
from liftdrag.pictures.bench import Mark, draw_precision

FILES = (BENCH, "bench.csv", "bench.png", "numerics.toml")


def begin(found: Benched) -> None:
    """Make the folder a bench's. Raises InputError when it is that of something else."""
    folder = found.stand.folder
    try:
        if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
            folder.mkdir(parents=True, exist_ok=True)
            write_json(folder / BENCH, found.to_dict())
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be used: {error.strerror}.") from None
    if not _is_of(folder, found):
        raise InputError(
            f"{folder} holds something else than a bench of this case on {found.stand.engine}; "
            "choose another --out, or remove it."
        )


def _is_of(folder: Path, found: Benched) -> bool:
    try:
        record = read_json(folder / BENCH)
    except InputError:
        return False
    same = record.get("tables") == dict(found.case.tables)
    return same and record.get("engine") == found.stand.engine


def write(found: Benched) -> None:
    """The tables, the picture and the recommendation. Raises RunFailed."""
    import pandas as pd

    folder = found.stand.folder
    write_json(folder / BENCH, found.to_dict())
    try:
        pd.DataFrame(list(found.rows())).to_csv(folder / "bench.csv", index=False)
        (folder / "numerics.toml").write_text(found.block(), "utf-8")
        _draw(found, folder / "bench.png")
    except OSError as error:
        status = "disk_full" if error.errno == errno.ENOSPC else "engine_error"
        raise RunFailed(status, f"Nothing was written to {folder}: {error.strerror}.") from None


def _draw(found: Benched, path: Path) -> None:
    marks = {name: _marks(found, name) for name in found.tolerances}
    fronts = {
        name: [marks[name][key] for key in best(found.runs, name)] for name in found.tolerances
    }
    title = f"{found.case.name} on {found.stand.engine}: run time against error"
    panels = {name: list(mine.values()) for name, mine in marks.items()}
    if all(panels.values()):
        draw_precision(title, panels, fronts, path)


def _marks(found: Benched, quantity: str) -> dict[Key, Mark]:
    spent, judged = costs(found.runs), judge(found.runs, quantity)
    return {
        key: Mark(*key, spent[key].cpu_s, judged[key].total_error)
        for key in found.keys
        if key in judged
    }
