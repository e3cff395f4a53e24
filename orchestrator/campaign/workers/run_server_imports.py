"""Imported by the run server alone: what every run needs, before one is forked from it."""

# ruff: noqa: E402 - the number of threads is read, and garbage looked for, by what is imported
import os

# A fork has no threads but its first; runs share the cores by processes as it is.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import gc
import signal

gc.disable()  # what is imported stays

import cv2

import orchestrator.campaign.workers.run_order
import orchestrator.run.flight.run
from orchestrator.campaign.workers.run_server import remove_listeners_at_exit
from orchestrator.run.perception.warm_up import load_kept_kernels

__all__ = ["orchestrator"]

for _number in (signal.SIGTERM, signal.SIGHUP):
    # They go to the whole process group; the server ends when its campaign does.
    signal.signal(_number, lambda *_: None)
cv2.setNumThreads(1)  # threads of its own would not be in a fork
remove_listeners_at_exit()
load_kept_kernels()
gc.collect()
gc.freeze()
gc.enable()
