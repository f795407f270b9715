"""Time and memory of a piece of work, measured as all benchmarks of dense depth do."""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.data import ROOT


def median_seconds(
    work: Callable[[], object], repeats: int, enough: float = np.inf, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Median time of repeats, s; after `enough` seconds no other one begins."""
    taken: list[float] = []
    while len(taken) < repeats and sum(taken) < enough:
        start = clock()
        work()
        taken.append(clock() - start)
    return float(np.median(taken))


def peak_mib() -> float:
    """Largest memory that this process has held, MiB."""
    try:  # Linux counts in `getrusage` what the process held that started this one
        status = Path("/proc/self/status").read_text()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def apart(module: str, words: Sequence[str], threads: int) -> dict[str, float]:
    """Figures that a benchmark prints as its last line when it runs in a process of its own with so many threads."""
    few = {"NUMBA_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", f"benchmarks.{module}", *words]
    done = subprocess.run(command, cwd=ROOT, env={**os.environ, **few}, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[1:])} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])
