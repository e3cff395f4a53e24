"""A program whose cluster has lost its head ends by exit code 3, and says so."""

import io
import socket
import sys
import threading
import time

import pytest

from orchestrator.engines.head_watch import watched_head


def test_a_head_that_is_gone_ends_the_program_and_one_that_answers_does_not(
    capfd: pytest.CaptureFixture[str],
) -> None:
    ended = threading.Event()
    codes: list[int] = []

    def end(code: int) -> None:
        codes.append(code)
        ended.set()

    with socket.create_server(("127.0.0.1", 0)) as head:
        address = f"127.0.0.1:{head.getsockname()[1]}"
        with watched_head(address, poll_s=0.02, silent_s=0.1, end=end):
            time.sleep(0.5)
            assert not codes
            head.close()
            assert ended.wait(20)
    assert codes == [3]
    assert f"the head of the Ray cluster at {address} has not answered" in capfd.readouterr().err


def test_a_program_that_is_over_is_not_ended() -> None:
    codes: list[int] = []
    with watched_head("127.0.0.1:9", poll_s=0.2, silent_s=0.1, end=codes.append):
        pass
    time.sleep(0.5)
    assert not codes


def test_a_program_without_a_terminal_is_ended_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    class GoneTerminal(io.StringIO):
        def write(self, text: str) -> int:
            raise BrokenPipeError(32, "Broken pipe")

    ended = threading.Event()
    monkeypatch.setattr(sys, "stderr", GoneTerminal())
    with watched_head("127.0.0.1:9", poll_s=0.02, silent_s=0.1, end=lambda _: ended.set()):
        assert ended.wait(60)
