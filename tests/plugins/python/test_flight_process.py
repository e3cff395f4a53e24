"""The process that flies for another program, without a flight."""

import io
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from wil_campaign.orchestrator.campaign.campaign_runner import (
    CampaignOutcome,
    CampaignWatcher,
)
from wil_campaign.orchestrator.campaign.flight_options import USUAL
from wil_campaign.orchestrator.cli.run_selection import ALL
from wil_campaign.plugins.python import flight_process
from wil_campaign.plugins.python.flight_messages import (
    CampaignEnded,
    CampaignMessage,
    FlightRequest,
    encode_line,
    encode_request,
)
from wil_campaign.plugins.python.flight_process import (
    MessageWatcher,
    _fly_campaign,
    _fly_to_end,
    _stop_at_end,
)


class BrokenInput(io.BytesIO):
    """Standard input that cannot be read."""

    def readline(self, size: int | None = -1, /) -> bytes:
        raise OSError(5, "Input/output error")


@pytest.mark.parametrize("commands", [io.BytesIO(b""), io.BytesIO(b"stop\n"), BrokenInput()])
def test_all_vehicles_land_when_the_input_ends_has_a_line_or_breaks(
    commands: io.BytesIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "kill", lambda pid, number: sent.append((pid, number)))
    _stop_at_end(commands)
    assert sent == [(os.getpid(), signal.SIGINT)]


REQUEST = encode_request(FlightRequest(file=Path("gate.yaml"), choice=ALL, options=USUAL))
TEXTS = [f"{number}: " + 1000 * "x" for number in range(200)]
"""More than a pipe holds."""


def test_a_program_that_does_not_read_keeps_no_campaign_from_landing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown = threading.Event()

    @contextmanager
    def ready(*_: object) -> Iterator[tuple[None, None]]:
        yield None, None

    def fly(*arguments: Any) -> CampaignOutcome:
        watcher: CampaignWatcher = arguments[-1]
        for text in TEXTS:
            watcher.say(text)
        flown.set()
        return CampaignOutcome(summary=None, folder=tmp_path, exit_code=4)  # type: ignore[arg-type]

    monkeypatch.setattr(flight_process, "ready_flight", ready)
    monkeypatch.setattr(flight_process, "fly_campaign", fly)
    monkeypatch.setattr(flight_process, "write_final_report", lambda _: None)
    reader, writer = os.pipe()
    with os.fdopen(reader, "rb") as messages:
        with os.fdopen(writer, "wb") as stream:
            watcher = MessageWatcher(stream)
            flying = threading.Thread(
                target=lambda: watcher.send(_fly_to_end(_fly_campaign, REQUEST, watcher)),
                daemon=True,
            )
            flying.start()
            has_flown = flown.wait(20.0)
            lines = [messages.readline() for _ in (*TEXTS, "its end")]
            flying.join(60.0)
        assert messages.read() == b""
    assert has_flown
    ended = CampaignEnded(folder=str(tmp_path), exit_code=4)
    assert lines == [
        *(encode_line(CampaignMessage(text=text)) for text in TEXTS),
        encode_line(ended),
    ]
