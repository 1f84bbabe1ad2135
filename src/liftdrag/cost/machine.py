"""What this machine has: cores, and memory that is free."""

from __future__ import annotations

import os
import re
from pathlib import Path

MEMINFO = Path("/proc/meminfo")

CONTAINER = Path("/sys/fs/cgroup/memory.max")
"""What a container says of its memory: bytes, or "max"."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def free_memory() -> int | None:
    """Bytes that programs may still take, where Linux says it."""
    return _bytes_of("MemAvailable")


def whole_memory() -> int | None:
    """Bytes that the machine has, or those that its container may take, where Linux says it."""
    whole = _bytes_of("MemTotal")
    try:
        return min(int(CONTAINER.read_text()), whole or 2**63)
    except (OSError, ValueError):
        return whole


def _bytes_of(name: str) -> int | None:
    try:
        found = re.search(rf"^{name}:\s+(\d+) kB", MEMINFO.read_text(), re.MULTILINE)
    except OSError:
        return None
    return int(found[1]) * 1024 if found else None
