"""Time and memory of a piece of work, measured as all benchmarks of dense depth do."""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numba
import numpy as np

from benchmarks.data import ROOT


def median_seconds(work: Callable[[], object], repeats: int) -> float:
    """Median of the time of repeats, s."""
    return median_times(work, repeats)[0]


def median_times(work: Callable[[], object], repeats: int, enough: float = np.inf) -> tuple[float, float]:
    """Medians of the clock's and of the processor's time of repeats, s; no other begins after `enough` seconds."""
    taken: list[tuple[float, float]] = []
    while len(taken) < repeats and sum(clock for clock, _ in taken) < enough:
        taken.append(timed(work)[1:])
    clock, processor = np.median(taken, axis=0)
    return float(clock), float(processor)


def timed(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """What a piece of work returns, and its time by the clock and of the processor, s."""
    start = time.perf_counter(), time.process_time()
    found = work()
    return found, time.perf_counter() - start[0], time.process_time() - start[1]


def few_threads(threads: int) -> None:
    """Give numba and OpenCV so many threads, numba no more than it was started with."""
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    cv2.setNumThreads(threads)


def held_mib() -> float:
    """Memory that this process holds now, MiB; from here on `peak_mib` counts anew where the system lets it."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
        return _status("VmRSS")
    except OSError:
        return peak_mib()


def peak_mib() -> float:
    """Largest memory that this process has held, MiB."""
    try:  # Linux counts in `getrusage` what the process held that started this one
        return _status("VmHWM")
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def _status(name):
    return int(Path("/proc/self/status").read_text().split(f"{name}:")[1].split()[0]) / 1024


def apart(module: str, words: Sequence[str], threads: int) -> dict[str, float]:
    """Figures that a benchmark prints as its last line when it runs in a process of its own with so many threads."""
    few = {"NUMBA_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", f"benchmarks.{module}", *words]
    done = subprocess.run(command, cwd=ROOT, env={**os.environ, **few}, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[1:])} failed:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])
