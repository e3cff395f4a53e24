"""What is done while a vehicle's readings are awaited before a flight."""

from types import SimpleNamespace
from typing import Any

import pytest

from wil_campaign.foundation.clocks.virtual_loop import run_virtual
from wil_campaign.orchestrator.external.external_readings import ExternalReadings
from wil_campaign.vehicles.sources.camera_source import SourceError


@pytest.mark.parametrize(("kind", "count"), [("mavlink", 6), ("zmq", 0)])
def test_missing_telemetry_is_requested_once_a_second(kind: str, count: int) -> None:
    """A radio that is full of requests carries no readings."""
    requested: list[None] = []
    awaited: Any = ExternalReadings.__new__(ExternalReadings)
    awaited._from_setup = SimpleNamespace(kind=kind, shown_as="", open_s=5.5)
    driver = SimpleNamespace(request_missing=lambda: requested.append(None))
    awaited._context = SimpleNamespace(driver=driver)
    awaited._live = SimpleNamespace(newest=None, missing_reading_text=lambda s: f"none in {s} s")
    with pytest.raises(SourceError, match=r"none in 5\.5 s"):
        run_virtual(awaited.ready(frame=None))
    assert len(requested) == count
