"""Builds the recorder of a run by the campaign's recording settings."""

import asyncio
import time
from collections.abc import Mapping

from wil_campaign.orchestrator.recording.mcap.mcap_settings import recording_settings
from wil_campaign.orchestrator.recording.recording_facts import facts_of
from wil_campaign.orchestrator.recording.run_recorder import RunRecorder
from wil_campaign.orchestrator.recording.timestamps import VIRTUAL_EPOCH_S
from wil_campaign.orchestrator.state.run_setup import RunSetup
from wil_campaign.orchestrator.state.run_state import RunState


def recorder_of(setup: RunSetup, run_state: RunState, kinds: Mapping[str, str]) -> RunRecorder:
    """Return the recorder of a run, not yet opened; its failure decides the run.

    kinds: of the oracles, by name.
    """
    loop = asyncio.get_running_loop()
    epoch_s = VIRTUAL_EPOCH_S if setup.clock == "virtual" else time.time() - loop.time()
    return RunRecorder(
        folder=setup.order.folder,
        time=loop.time,
        epoch_s=epoch_s,
        # Under the wall clock the guard process logs the frames: its log survives a crash here.
        vehicles=tuple(one.name for one in setup.guarded if setup.clock == "virtual"),
        collision_oracles=frozenset(name for name, kind in kinds.items() if kind == "collision"),
        clock=setup.clock,
        settings=recording_settings(setup.campaign.record),
        broken=lambda why: run_state.decide("ERROR", why, source="recording"),
        facts=facts_of(setup),
        fault=run_state.fault,
        incomplete=lambda why: run_state.decide(
            "INVALID", why, source="recording", ends_flight=False
        ),
        max_loss=setup.campaign.record.max_loss,
    )
