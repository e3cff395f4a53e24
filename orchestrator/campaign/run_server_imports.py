"""Imported by the run server alone: what every run needs, before one is forked from it."""

import os

# A fork has no threads but its first; runs share the cores by processes as it is.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import gc
import signal

import orchestrator.campaign.run_order

__all__ = ["orchestrator"]

for _number in (signal.SIGTERM, signal.SIGHUP):
    # They go to the whole process group; the server ends when its campaign does.
    signal.signal(_number, lambda *_: None)
gc.collect()
gc.freeze()
