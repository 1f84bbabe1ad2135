"""A SLURM of one node on this machine, in a folder of its own."""

from __future__ import annotations

import getpass
import os
import platform
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

NODE = platform.node().partition(".")[0]

CONF = """
ClusterName=tiny
SlurmctldHost={node}(127.0.0.1)
SlurmctldPort={control_port}
SlurmdPort={node_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket
CredType=cred/munge
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=1,batch_sched_delay=0
SlurmdParameters=config_overrides
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/control.pid
SlurmdPidFile={folder}/node.pid
KillWait=1
NodeName={node} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


@contextmanager
def cluster(folder: Path) -> Iterator[Path]:
    """The configuration (SLURM_CONF) of a SLURM that has an idle node while the block runs."""
    for name in ("munge", "state", "spool"):
        (folder / name).mkdir(mode=0o700)
    key, conf = folder / "munge" / "key", folder / "slurm.conf"
    key.write_bytes(os.urandom(1024))
    key.chmod(0o400)
    control_port, node_port = free_ports()
    conf.write_text(
        CONF.format(
            node=NODE,
            user=getpass.getuser(),
            folder=folder,
            control_port=control_port,
            node_port=node_port,
        )
    )
    munge = [f"--{name}-file={folder}/munge/{name}" for name in ("key", "pid", "log", "seed")]
    with ExitStack() as own:
        socket_file = folder / "munge" / "socket"
        own.enter_context(
            daemon(folder, conf, "munged", "--force", "-F", *munge, f"--socket={socket_file}")
        )
        wait(socket_file.exists)
        own.enter_context(daemon(folder, conf, "slurmctld", "-D"))
        own.enter_context(daemon(folder, conf, "slurmd", "-D"))
        wait(lambda: asked(conf, "sinfo", "-h", "-o", "%T").strip() == "idle")
        yield conf
        asked(conf, "scancel", "--me")
        wait(lambda: not asked(conf, "squeue", "-h").strip())


def free_ports() -> list[int]:
    """Two ports that nobody listens at."""
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


@contextmanager
def daemon(folder: Path, conf: Path, name: str, *words: str) -> Iterator[None]:
    """A daemon that lives as long as the block."""
    found = shutil.which(name, path=f"{os.environ['PATH']}:/usr/sbin")
    assert found, f"{name} is not installed"
    with (folder / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(
            [found, *words], stdout=log, stderr=log, env=os.environ | {"SLURM_CONF": str(conf)}
        )
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


def asked(conf: Path, *command: str) -> str:
    """What a command of SLURM says."""
    environment = os.environ | {"SLURM_CONF": str(conf)}
    return subprocess.run(command, env=environment, capture_output=True, text=True).stdout


def wait(reached, patience_s: float = 120.0) -> None:
    """Return once `reached()`."""
    until = time.monotonic() + patience_s
    while not reached():
        assert time.monotonic() < until, "it took too long"
        time.sleep(0.3)
