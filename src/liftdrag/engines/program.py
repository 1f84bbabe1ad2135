"""LAMMPS and LIGGGHTS as programs of this machine: Debian's `lmp` and `liggghts`, or your own."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import NoReturn

from liftdrag.deck import Plan
from liftdrag.deck.dialect import LAMMPS, LAMMPS_2021, LAMMPS_2023, LIGGGHTS, Dialect
from liftdrag.engines import meeting, mpi
from liftdrag.engines.base import About, Enough, Outcome, Progress
from liftdrag.engines.family import Family
from liftdrag.engines.watchdog import FOREVER, Limits
from liftdrag.errors import InputError

_LAMMPS = re.compile(r"Massively Parallel Simulator - (\d+ \w+ \d+)(?: - (Update \d+))?")
_LIGGGHTS = re.compile(r"LIGGGHTS \(Version ([^,]+),")
_LIBRARY = re.compile(r"(libmpi\S*\.so\S*) => (/\S+)?")
_PACKAGES = re.compile(r"Installed packages:\s+((?:[A-Z0-9-]+\s+)+)")

REWRITTEN = datetime(2022, 12, 22)
"""The first LAMMPS with the granular contacts rewritten."""

CONSTANT_RESTITUTION = datetime(2024, 4, 17)
"""The first LAMMPS with a damping for a constant restitution."""


@dataclass(frozen=True)
class Kind:
    """A program by its engine's name: what it calls itself, and how it is installed."""

    name: str
    title: str
    pattern: re.Pattern[str]
    install: str

    @property
    def variable(self) -> str:
        """The environment variable that may name its path."""
        return f"LIFTDRAG_{self.name.upper()}"


LMP = Kind("lmp", "LAMMPS", _LAMMPS, "apt-get install lammps")
LIGGGHTS_BINARY = Kind("liggghts", "LIGGGHTS", _LIGGGHTS, "apt-get install liggghts")


class Program(Family):
    """A program that reads a deck with `-in`; with `path`, that one and no other."""

    def __init__(self, kind: Kind, path: Path | None = None):
        self.kind = kind
        self.name = kind.name
        self.log = f"log.{kind.title.lower()}"
        self._given = path

    @cached_property
    def path(self) -> Path:
        """Where it is: as given, as the environment says, or on the PATH. Raises InputError."""
        named = self._given or os.environ.get(self.kind.variable)
        if named:
            return _executable(Path(named), self.kind)
        for folder in os.get_exec_path():
            found = shutil.which(self.name, path=folder)
            if found and Path(folder).resolve() != Path(sysconfig.get_path("scripts")).resolve():
                return Path(found).absolute()
        raise InputError(
            f"The engine {self.name} is not installed; run: {self.kind.install} (Debian), or name "
            f"its path with --engine-path or {self.kind.variable}."
        )

    @cached_property
    def _help(self) -> str:
        return _output([str(self.path), "-h"])

    def about(self) -> About:
        """What the program says of itself. Raises InputError when it is another program."""
        return self._about

    @cached_property
    def _about(self) -> About:
        match = self.kind.pattern.search(self._help)
        if match is None:
            said = " ".join(self._help.split()[-20:])
            raise InputError(
                f"{self.path} does not say that it is {self.kind.title}; it says {said[:160]!r}. "
                "Name another with --engine-path, or choose another --engine."
            )
        version = " ".join(filter(None, match.groups()))
        flavour = self.flavour.name if self.flavour else "none"
        return About(self.name, version, self.path, flavour)

    def packages(self) -> tuple[str, ...]:
        """The packages compiled in, where the program lists them."""
        match = _PACKAGES.search(self._help)
        return tuple(match[1].split()) if match else ()

    @property
    def dialect(self) -> Dialect:
        """That of LIGGGHTS, or of LAMMPS at its date."""
        if self.kind is LIGGGHTS_BINARY:
            return LIGGGHTS
        date = " ".join(self.about().version.split()[:3])
        try:
            released = datetime.strptime(date, "%d %b %Y")
        except ValueError:
            return LAMMPS
        if released >= CONSTANT_RESTITUTION:
            return LAMMPS
        return LAMMPS_2023 if released >= REWRITTEN else LAMMPS_2021

    @cached_property
    def _library(self) -> Path | None:
        match = _LIBRARY.search(_output(["ldd", str(self.path)]))
        return Path(match[2] or match[1]) if match else None

    @property
    def flavour(self) -> mpi.Flavour | None:
        """The MPI that it is linked with; None for none."""
        if self._library is None:
            return None
        return mpi.OPEN_MPI if re.search(r"\.so\.(40|20)", self._library.name) else mpi.MPICH

    def world(self) -> mpi.World:
        """The ranks of its own MPI's launcher."""
        return mpi.world(os.environ, self.flavour, f"the engine {self.name}")

    def check(self, ranks: int) -> None:
        """Raise InputError as the family does, and when the ranks of a job cannot meet."""
        super().check(ranks)
        if self.world().size > 1:
            meeting.check()

    def command(self, start: str, folder: Path) -> list[str]:  # noqa: ARG002
        """The program on a deck of the folder that it is started in."""
        return [str(self.path), "-in", start, "-log", self.log, "-screen", "none"]

    def join(self) -> NoReturn:
        """Become a rank of the program, which gets the deck's lines from the first one."""
        folder = meeting.wait()
        if folder is None:
            sys.exit(0)
        os.chdir(folder)
        os.execv(self.path, [str(self.path), "-log", "none", "-screen", "none"])

    def release(self) -> None:
        """Send the waiting ranks home."""
        if self.world().size > 1:
            meeting.dismiss()

    def summon(self, folder: Path) -> None:
        """Call the waiting ranks to the run's folder."""
        meeting.announce(folder.resolve())

    def run(
        self,
        plan: Plan,
        folder: Path,
        progress: Progress,
        alone: bool = False,
        enough: Enough | None = None,
        limits: Limits = FOREVER,
    ) -> Outcome:
        """As the family does; the ranks' meeting place is tidied up."""
        try:
            return super().run(plan, folder, progress, alone, enough, limits)
        finally:
            if not alone and self.world().size > 1:
                meeting.end()

    def launcher(self) -> Path:
        """The launcher that belongs to the library that it is linked with."""
        if self.flavour is None or self._library is None:
            raise InputError(
                f"The MPI of {self.path} cannot be seen: it was built without, or is a script; run "
                "with --ranks 1."
            )
        return mpi.launcher(self.flavour, self._library)

    def settings(self) -> dict[str, str]:
        """What Open MPI needs to start at all."""
        return mpi.settings(self.flavour, os.environ) if self.flavour else {}


def _executable(path: Path, kind: Kind) -> Path:
    if not path.is_file() or not os.access(path, os.X_OK):
        raise InputError(
            f"{path} is not a program; name the path of {kind.title} with --engine-path or "
            f"{kind.variable}."
        )
    return path.absolute()


def _output(command: list[str]) -> str:
    """What a program says, in a folder of its own: LIGGGHTS writes a log even of its help."""
    environment = mpi.outside(os.environ) | mpi.settings(mpi.OPEN_MPI, os.environ)
    with tempfile.TemporaryDirectory(prefix="liftdrag-") as folder:
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=30,
                errors="replace",
                stdin=subprocess.DEVNULL,
                env=environment,
                cwd=folder,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired):
            return ""
    return done.stdout + done.stderr
