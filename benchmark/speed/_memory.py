"""Memory: how much processes hold and how much is free."""

import ctypes
import gc
import multiprocessing
import os
from pathlib import Path


def free_mb() -> float:
    """Free memory [MB]."""
    lines = Path("/proc/meminfo").read_text().splitlines()
    return next(float(line.split()[1]) / 1e3 for line in lines if line.startswith("MemAvailable"))


def held_mb() -> float:
    """Resident memory of this process and of its child processes [MB]."""
    pids = [os.getpid(), *(process.pid for process in multiprocessing.active_children())]
    pages = sum(int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in pids)
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def give_back() -> None:
    """Return freed memory to the system, so that later measurements see what is taken next."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
