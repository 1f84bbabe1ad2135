"""A settled bed for all runs of a study that begin from it: the first settles, the others wait."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from liftdrag import beds
from liftdrag.case import Case
from liftdrag.engines.base import Progress
from liftdrag.errors import InputError
from liftdrag.lock import held, is_held
from liftdrag.scene import TankScene
from liftdrag.study.tasks import BEDS, TASKS

WAIT_S = 0.5


def use_beds(study: Path) -> None:
    """Have this process keep beds with the study, unless the environment says where, or nowhere."""
    os.environ.setdefault("LIFTDRAG_BEDS", str((study / BEDS).absolute()))


@contextmanager
def shared_bed(case: Case, study: Path, folder: Path, progress: Progress) -> Iterator[Progress]:
    """The progress of a run in `folder`, which keeps the bed as soon as the run has settled it.

    Waits while another run settles the same bed.
    """
    scene = case.scene
    if not isinstance(scene, TankScene) or os.environ.get("LIFTDRAG_BEDS") == "off":
        yield progress
        return
    with ExitStack() as own:
        if not _ours(scene, study, progress, own):
            yield progress
            return
        yield _keeping(scene, folder, progress)


def _keeping(scene: TankScene, folder: Path, progress: Progress) -> Progress:
    """Progress that keeps the bed when the drive begins."""
    bed, begun = beds.find(scene), False

    def look(stage: str, done: int, total: int) -> None:
        nonlocal begun
        if stage == "drive" and not begun:
            begun = True
            beds.keep(bed, scene, folder)
        progress(stage, done, total)

    return look


def _ours(scene: TankScene, study: Path, progress: Progress, own: ExitStack) -> bool:
    """Whether the bed is this process's to settle: true once it is claimed, false once it is kept.

    The engine of a run keeps the claim to its end, so the kept bed counts, not the claim.
    """
    place = study / TASKS / f"bed-{beds.key_of(scene)}"
    place.mkdir(parents=True, exist_ok=True)
    while beds.kept(scene) != "settled":
        try:
            own.enter_context(held(place))
        except InputError:
            if not is_held(place):
                return False
            progress("bed", 0, 1)
            time.sleep(WAIT_S)
        else:
            return beds.kept(scene) != "settled"
    return False
