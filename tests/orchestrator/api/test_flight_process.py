"""The process that flies for another program, without a flight."""

import io
import os
import signal

import pytest

from orchestrator.api.flight_process import _stop_at_end


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
