"""A command that waited for a process that stood still: an abort is executed, nothing else is."""

import asyncio
import json
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.orchestrator.operator.controllers import FakeFleet, make_controller
from wil_campaign.orchestrator.operator.operator_channels import open_operator_channels
from wil_campaign.orchestrator.operator.socket_client import ask_operator_socket
from wil_campaign.safety.guard.operator import operator_socket
from wil_campaign.safety.guard.operator.operator_lines import RefusedLineError, parse_line
from wil_campaign.safety.guard.operator.operator_socket import POINTER


@pytest.mark.parametrize("stood_s", [0.0, 60.0])
async def test_a_program_that_stood_still_executes_no_old_command_but_an_abort(
    tmp_path: Path, short_folder: Path, monkeypatch: pytest.MonkeyPatch, stood_s: float
) -> None:
    """As after Ctrl-Z: the terminal of the command has long said that nobody answered."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(short_folder))
    woken = SimpleNamespace(monotonic=lambda: time.monotonic() + stood_s)
    monkeypatch.setattr(operator_socket, "time", woken)
    controller = make_controller(tmp_path, FakeFleet())
    async with open_operator_channels(controller):
        path = Path(json.loads((tmp_path / POINTER).read_text())["socket"])

        async def answer(command: str, **more: str) -> tuple[object, object]:
            found = await asyncio.to_thread(ask_operator_socket, path, command, who="anna", **more)
            return found["ok"], "more than 5 s ago" in found["text"]

        is_late = stood_s > 0.0
        for command in ("hold", "resume"):
            assert await answer(command) == (not is_late, is_late)
        fence = await answer("geofence", geofence="box: {}", id="a")
        assert fence == (False, is_late)  # else refused, for nothing flies
        assert await answer("abort") == (True, False)
    assert controller.stopped == "command"


@pytest.mark.parametrize("at_s", ["94.9", "NaN", "-Infinity", f"-1{'0' * 400}", "true", '"100"'])
def test_a_time_that_is_old_or_none_is_refused_but_of_an_abort(at_s: str) -> None:
    def line(command: str) -> bytes:
        return f'{{"command": "{command}", "at_s": {at_s}}}'.encode()

    with pytest.raises(RefusedLineError, match=r"^resume: "):
        parse_line(line("resume"), now_s=100.0)
    assert parse_line(line("abort"), now_s=100.0)
    assert parse_line(b'{"command": "resume"}', now_s=100.0)
    assert parse_line(b'{"command": "resume", "at_s": 95.1}', now_s=100.0)
