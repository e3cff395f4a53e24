"""Imports everything that a run needs; only the run server imports this, before it forks runs."""

# ruff: noqa: E402 - the imports read the number of threads, and the collector is off meanwhile
import os

# A fork only has its first thread; runs share the cores by processes anyway.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import gc
import signal
from contextlib import suppress

from wil_campaign.foundation.processes.interrupts import ignore_ctrl_c

gc.disable()  # imported objects stay
ignore_ctrl_c()  # and so do the runs: the campaign's process says what becomes of them

import cv2

from wil_campaign.campaigns.expansion.case_reader import load_models
from wil_campaign.foundation.files.problems import BadInput
from wil_campaign.hooks import live_views
from wil_campaign.installed_plugins import loaded_additions
from wil_campaign.orchestrator.campaign.workers import run_order
from wil_campaign.orchestrator.campaign.workers.run_server import (
    IGNORED_SIGNALS,
    remove_listeners_at_exit,
)
from wil_campaign.orchestrator.recording import run_video, video
from wil_campaign.orchestrator.run.flight import run
from wil_campaign.orchestrator.run.perception.warm_up import load_kept_kernels
from wil_campaign.orchestrator.run.stages import return_flight
from wil_campaign.worlds.scene.shapes import room_textures

__all__ = ["return_flight", "run", "run_order", "run_video", "video"]

for _number in IGNORED_SIGNALS:
    signal.signal(_number, lambda *_: None)
cv2.setNumThreads(1)  # its threads would not exist in a fork
remove_listeners_at_exit()
load_kept_kernels()
room_textures(0)  # of rooms without a seed of their own
with suppress(BadInput):  # a plugin that cannot be used is a fault of the runs that use it
    load_models()
    loaded_additions(live_views, "feed")
gc.freeze()
gc.enable()
