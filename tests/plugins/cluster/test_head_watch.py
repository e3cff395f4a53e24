"""A program whose cluster has lost its head ends by exit code 3, and says so."""

import io
import socket
import sys
import threading
import time
from types import SimpleNamespace

import pytest

from tests.plugins.cluster.fake_ray import FakeExceptions
from wil_campaign.orchestrator.campaign.workers.run_engine import EngineError
from wil_campaign.plugins.cluster import head_watch, ray_engine
from wil_campaign.plugins.cluster.head_watch import await_head, watched_head


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


def test_a_head_that_is_silent_ends_the_program_as_soon_as_one_that_refuses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As a machine without power: each try lasts for its limit. Ray ends us after a minute."""
    now_s = [0.0]
    tries: list[float] = []

    def try_in_vain(_: str) -> bool:
        now_s[0] += 5.0
        tries.append(now_s[0])
        return False

    ended = threading.Event()
    monkeypatch.setattr(head_watch, "_accepts_connection", try_in_vain)
    monkeypatch.setattr(head_watch, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    with watched_head("127.0.0.1:9", poll_s=0.001, silent_s=30.0, end=lambda _: ended.set()):
        assert ended.wait(20)
    assert tries[-1] == 30.0


def test_a_cluster_without_a_head_is_not_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ray tried for more than ten minutes, with nothing said but its own log."""
    ray = SimpleNamespace(
        init=lambda **_: pytest.fail("joined"), shutdown=lambda: None, exceptions=FakeExceptions
    )
    monkeypatch.setattr(ray_engine, "_import_ray", lambda: ray)
    monkeypatch.setattr(ray_engine, "await_head", lambda address: await_head(address, 0.1))
    with socket.create_server(("127.0.0.1", 0)) as head:
        address = f"127.0.0.1:{head.getsockname()[1]}"
        assert await_head(address)
    with (
        pytest.raises(EngineError, match=f"no head of a Ray cluster answers at {address}"),
        ray_engine.running_ray(address),
    ):
        pass


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
