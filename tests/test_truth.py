"""Whether a run has finished, and why not: what broken ones leave, and real ones broken here."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
from math import inf
from pathlib import Path

import pytest
from conftest import LONG, tiny_tank
from kills import TANK, engines_in

from liftdrag.case import Case, parse
from liftdrag.deck import Plan
from liftdrag.engines import checks, process
from liftdrag.engines.watchdog import SILENCE, Limits, Watchdog, limits
from liftdrag.errors import InputError, RunFailed
from liftdrag.folder import Record
from liftdrag.resume import resume
from liftdrag.runner import run

GRID = "  1 by 1 by 1 MPI processor grid\n"
SETTLING = GRID + "LIFTDRAG STAGE settle 2382\n"
DRIVING = GRID + "LIFTDRAG SETTLED kinetic 3.75409901232348e-12\nLIFTDRAG STAGE drive 100\n"
STEPS = "        84    0.0075600            656   3.2040233e-06             0             0 \n"

LEFT = {
    "wheel loses grains": (
        SETTLING + STEPS + "ERROR: Lost atoms: original 656 current 652\n",
        "",
        1,
        "lost_grains",
        "ERROR: Lost atoms: original 656 current 652",
    ),
    "lmp loses grains": (
        SETTLING + "ERROR: Lost atoms: original 656 current 652 (src/thermo.cpp:439)\n",
        "",
        1,
        "lost_grains",
        "ERROR: Lost atoms: original 656 current 652 (src/thermo.cpp:439)",
    ),
    "LIGGGHTS loses grains": (
        SETTLING + "ERROR: Lost atoms: original 651 current 651 (./src/thermo.cpp:445)\n",
        "",
        1,
        "lost_grains",
        "ERROR: Lost atoms: original 651 current 651 (./src/thermo.cpp:445)",
    ),
    "a position is no number": (
        SETTLING
        + "ERROR on proc 0: Non-numeric positions - simulation unstable (src/domain.cpp)\n",
        "",
        1,
        "not_finite",
        "ERROR on proc 0: Non-numeric positions - simulation unstable (src/domain.cpp)",
    ),
    "wheel on a full disk": (
        DRIVING + STEPS + "ERROR on proc 0: Error writing dump surface: No space left on device "
        "(src/src/dump.cpp:543)\nTotal wall time: 0:00:00\n",
        "",
        1,
        "disk_full",
        "ERROR on proc 0: Error writing dump surface: No space left on device "
        "(src/src/dump.cpp:543)",
    ),
    "engine killed": (DRIVING + STEPS[:33], "", -9, "killed", None),
    "rank killed": (
        DRIVING + STEPS,
        "=   BAD TERMINATION OF ONE OF YOUR APPLICATION PROCESSES\n=   EXIT CODE: 9\n"
        "YOUR APPLICATION TERMINATED WITH THE EXIT STRING: Killed (signal 9)\n",
        9,
        "killed",
        None,
    ),
    "deck that stops": (DRIVING + STEPS, "", 0, "engine_error", STEPS.rstrip("\n")),
    "deck that ends early": (
        DRIVING + "LIFTDRAG FINISHED at step 90\n",
        "",
        0,
        "engine_error",
        "LIFTDRAG FINISHED at step 90",
    ),
    "no word at all": ("", "", 0, "engine_error", None),
}
PLAN = Plan("in.x", 1, 1e-5, {"settle": 50, "drive": 100}, 10, {"forces.dat": {"drag": "N"}})
WHOLE = "# Time-averaged data for fix forces\n# TimeStep v_drag\n" + "".join(
    f"{step} 0.5\n" for step in range(10, 101, 10)
)
FINISHED = DRIVING + "LIFTDRAG FINISHED at step 100\n"


@pytest.fixture(scope="module", autouse=True)
def looks_often():
    """A tiny run would otherwise end between two looks at its log."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "POLL_S", 0.02)
        yield


@pytest.mark.parametrize("name", LEFT)
def test_what_a_broken_run_left_says_why(name, tmp_path):
    log, said, code, status, evidence = LEFT[name]
    (tmp_path / "forces.dat").write_text(WHOLE)
    found, reason = checks.verdict(PLAN, tmp_path, log, said, code)
    assert found == status
    assert reason
    if evidence is not None:
        assert checks.last_words(log, said).endswith(evidence)


@pytest.mark.parametrize(
    ("damage", "status", "words"),
    [
        (lambda text: text, "finished", ""),
        (lambda text: text.replace("50 0.5\n", ""), "engine_error", "a gap or a row too many"),
        (lambda text: text.replace("50 0.5\n", "50 0.5\n50 0.5\n"), "engine_error", "step 50"),
        (lambda text: text.replace("10 0.5\n20 0.5\n", ""), "engine_error", "begins at step 30"),
        (lambda text: text.replace("100 0.5\n", ""), "engine_error", "ends at step 90"),
        (lambda text: text[:-5], "engine_error", "ends at step 90"),
        (lambda text: text.replace("50 0.5", "50 nan"), "not_finite", "not finite"),
        (lambda text: text.replace("50 0.5", "50 inf"), "not_finite", "not finite"),
        (lambda text: text.replace("50 0.5", "50 0.5.5"), "engine_error", "line 7"),
        (lambda _: "", "engine_error", "empty"),
    ],
)
def test_a_run_has_finished_with_a_whole_and_finite_series_alone(damage, status, words, tmp_path):
    (tmp_path / "forces.dat").write_text(damage(WHOLE))
    found, reason = checks.verdict(PLAN, tmp_path, FINISHED, "", 0)
    assert found == status
    assert words in reason


def test_a_disk_without_room_is_named_where_the_engine_could_not_say_so(tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=100))
    assert checks.verdict(PLAN, tmp_path, DRIVING, "", -9)[0] == "disk_full"
    (tmp_path / "forces.dat").write_text(WHOLE)
    assert checks.verdict(PLAN, tmp_path, FINISHED, "", 0)[0] == "finished"


def test_a_deck_that_was_changed_is_no_finished_run(tmp_path):
    def change(stage: str, _done: int, _total: int) -> None:
        if stage == "drive":
            (tmp_path / "in.tank").write_text("# another\n")

    with pytest.raises(RunFailed, match=r"in\.tank is not the file that was written for this run"):
        run(tiny_tank(), tmp_path, progress=change)
    record = json.loads((tmp_path / "result.json").read_text())
    assert record["status"] == "engine_error"
    assert record["quantities"] == {}


def test_an_engine_that_hangs_has_stalled(tmp_path, monkeypatch):
    """Stopped with SIGSTOP; afterwards none of its processes is left, and the run goes on."""

    def freeze(stage: str, done: int, _total: int) -> None:
        if stage == "drive" and done > 1000:
            for pid in engines_in(tmp_path):
                os.kill(pid, signal.SIGSTOP)

    monkeypatch.setenv(SILENCE, "4")
    with pytest.raises(RunFailed) as caught:
        run(TANK, tmp_path, progress=freeze)
    assert caught.value.status == "stalled"
    assert "wrote nothing for 4 s" in caught.value.reason
    assert caught.value.evidence
    assert engines_in(tmp_path) == []
    assert json.loads((tmp_path / "result.json").read_text())["status"] == "stalled"
    assert resume(None, tmp_path).status == "finished"


def test_a_run_that_takes_too_long_times_out(tmp_path):
    with pytest.raises(RunFailed) as caught:
        run(Case("long", parse(LONG, "it")), tmp_path, timeout_s=0.5)
    assert caught.value.status == "timeout"
    assert caught.value.reason.startswith("timeout: the run took 0.5 s. Go on with: liftdrag run")
    assert engines_in(tmp_path) == []


class TestWatchdog:
    """On a clock that the test turns."""

    @pytest.fixture
    def clock(self, monkeypatch):
        now = [100.0]
        monkeypatch.setattr("liftdrag.engines.watchdog.time.monotonic", lambda: now[0])
        return now

    def test_silence_counts_from_the_last_byte(self, clock, tmp_path):
        file = tmp_path / "log"
        dog = Watchdog(Limits(silence_s=3.0), [file])
        for look in range(12):
            if look % 3 == 0:
                file.write_bytes(bytes(look + 1))
            clock[0] += 1.0
            dog.look()
        clock[0] += 1.0
        dog.look()
        clock[0] += 1.0
        with pytest.raises(RunFailed, match="stalled"):
            dog.look()

    def test_a_machine_that_slept_was_not_silent(self, clock, tmp_path):
        dog = Watchdog(Limits(silence_s=3.0), [tmp_path / "log"])
        for _ in range(3):
            clock[0] += 1e5
            dog.look()
        clock[0] += 1e5
        with pytest.raises(RunFailed, match="stalled"):
            dog.look()

    def test_time_runs_out_whatever_is_written(self, clock):
        dog = Watchdog(Limits(run_s=10.0), ())
        clock[0] += 10.0
        dog.look()
        clock[0] += 0.1
        with pytest.raises(RunFailed, match="timeout"):
            dog.look()

    def test_silence_is_a_share_of_a_long_run(self, monkeypatch):
        assert limits(None, 60.0) == Limits(inf, 600.0)
        assert limits(90.0, 20_000.0) == Limits(90.0, 1000.0)
        monkeypatch.setenv(SILENCE, "7200")
        assert limits(None, 60.0).silence_s == 7200.0
        for bad in ("soon", "-1", "0", "nan"):
            monkeypatch.setenv(SILENCE, bad)
            with pytest.raises(InputError, match=f"{SILENCE}={bad} is no number of seconds"):
                limits(None, 60.0)


@pytest.mark.parametrize("name", ["lammps", pytest.param("lmp", marks=pytest.mark.validate)])
def test_a_disk_that_fills_up_is_named_and_the_run_goes_on_when_there_is_room(name, disk):
    def fill(stage: str, done: int, _total: int) -> None:
        if stage == "drive" and done > 1500:
            with (disk / "other").open("ab") as file:
                file.truncate(0)
                while os.statvfs(disk).f_bavail:
                    os.write(file.fileno(), bytes(4096))

    with pytest.raises(RunFailed) as caught:
        run(TANK, disk / "out", name, progress=fill)
    assert caught.value.status == "disk_full"
    assert "Go on with" in caught.value.reason
    assert not list((disk / "out").glob("result*"))
    (disk / "other").unlink()
    assert resume(None, disk / "out").status == "finished"
    assert Record.read(disk / "out").provenance["resumed"][0]["stage"] == "drive"


@pytest.fixture
def disk(tmp_path: Path):
    """A file system of four megabytes, where one may be mounted."""
    command = ["mount", "-t", "tmpfs", "-o", "size=4m", "liftdrag", str(tmp_path)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("no file system can be mounted here")
    yield tmp_path
    subprocess.run(["umount", "--lazy", str(tmp_path)], check=True)
