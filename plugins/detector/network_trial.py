"""Tests an ONNX file in a short-lived process, before any other process loads it.

OpenCV's reader ends its process on some damaged files, and a network may take any memory and time.
A program of its own, `python -m wil_campaign.plugins.detector.network_trial FILE WIDTH HEIGHT
MEGABYTES`; prints the step that failed and OpenCV's error, or nothing.
"""

import functools
import multiprocessing as mp
import resource
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

from wil_campaign.foundation.files.limits import MAX_NETWORK_BYTES
from wil_campaign.foundation.processes.process_memory import limited_allocation

CPU_S = 20
"""Limit of processor time for loading and running together."""
_WALL_S = 120.0
_SPARE_MB = 1000.0
_TIMES_FILE = 4.0
"""Memory limit: so many times the file's size, and the above for one image."""
LOADS, RUNS = "loads", "runs"


def network_refusal(path: Path, input_px: tuple[int, int]) -> str:
    """Return why a file of a network cannot be used; empty if it loads and runs.

    input_px: (width, height) of the network's input. In a child process of this program the file is
    not tested: there a crash ends one run or check only, and its parent reports it. Raises OSError.
    """
    if mp.parent_process() is not None:
        return ""
    facts = path.stat()
    return _refusal(path.resolve(), input_px, facts.st_size, facts.st_mtime_ns)


@functools.lru_cache(maxsize=64)
def _refusal(path: Path, input_px: tuple[int, int], size_bytes: int, changed_ns: int) -> str:
    """Return why a file of a network cannot be used; size and time tell versions of it apart."""
    del changed_ns
    name = path.name
    if size_bytes > MAX_NETWORK_BYTES:
        return f"'{name}' has {size_bytes:,} bytes; at most {MAX_NETWORK_BYTES:,} are read"
    memory_mb = _SPARE_MB + _TIMES_FILE * size_bytes / 1e6
    words = (str(path), *map(str, input_px), str(memory_mb))
    try:
        tried = subprocess.run(  # noqa: S603 - our own program
            [sys.executable, "-P", "-m", "wil_campaign.plugins.detector.network_trial", *words],
            check=False,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_WALL_S,
        )
    except subprocess.TimeoutExpired:
        return f"'{name}' does not load and run once within {_WALL_S:g} s"
    step, _, text = tried.stdout.partition(" ")
    if tried.returncode == -signal.SIGXCPU:
        return f"'{name}' does not load and run once within {CPU_S} s of processor time"
    if tried.returncode == 0 and step in {LOADS, RUNS}:
        done = "is not an ONNX network" if step == LOADS else f"cannot run on {input_px}"
        return f"'{name}' {done}: {text.strip()}"
    if tried.returncode:
        how = _exit_text(tried.returncode)
        return f"'{name}' is damaged, or not ONNX: OpenCV's reader crashed ({how}); export it again"
    return ""


def _exit_text(returncode: int) -> str:
    """Return how a trial ended in words."""
    if returncode >= 0:
        return f"exit status {returncode}"
    try:
        return signal.Signals(-returncode).name
    except ValueError:
        return f"signal {-returncode}"


def short_network_error(error: BaseException) -> str:
    """Return OpenCV's error about a network, short."""
    lines = str(error).strip().splitlines()
    return lines[0][-160:] if lines else "OpenCV gives no reason"


def main(arguments: list[str]) -> int:
    """Load a network and run it once, within limits; print the failed step and its error."""
    path, width_px, height_px, memory_mb = arguments
    cv2.setNumThreads(1)
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    step = LOADS
    with limited_allocation(float(memory_mb)):
        try:
            net = cv2.dnn.readNetFromONNX(path)
            if not net.empty():
                step = RUNS
                image = np.zeros((int(height_px), int(width_px), 3), np.uint8)
                net.setInput(cv2.dnn.blobFromImage(image, 1.0 / 255.0, swapRB=True))
                net.forward(net.getUnconnectedOutLayersNames())
        except (cv2.error, MemoryError) as error:
            sys.stdout.write(f"{step} {short_network_error(error)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
