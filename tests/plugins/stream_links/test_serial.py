"""Serial links over pseudo terminals, and the words of what goes wrong with real ones."""

import errno
import fcntl
import logging
import os
import pty
import struct
import termios
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from wil_campaign.plugins.stream_links.reconnection import BackOff
from wil_campaign.plugins.stream_links.serial import SerialLink
from wil_campaign.plugins.stream_links.serial_port import open_serial_port, serial_port_remedy
from wil_campaign.vehicles.driver import Driver
from wil_campaign.vehicles.errors import IdentifyError
from wil_campaign.vehicles.links.link import LinkError
from wil_campaign.vehicles.links.link_factory import open_link
from wil_campaign.vehicles.links.link_strings import LinkAddress, parse_link

QUICK = BackOff(first_s=0.01, longest_s=0.05)


class Cable:
    """The far end of a serial port, which can be unplugged and plugged in again."""

    def __init__(self, device: Path) -> None:
        self.device = device
        self.far = -1
        self.plug()

    def plug(self) -> None:
        self.far, near = pty.openpty()
        tty.setraw(self.far)
        self.device.unlink(missing_ok=True)
        self.device.symlink_to(os.ttyname(near))
        os.close(near)

    def unplug(self) -> None:
        if self.far >= 0:
            os.close(self.far)
            self.far = -1

    def say(self, data: bytes) -> None:
        os.write(self.far, data)

    def read(self) -> bytes:
        os.set_blocking(self.far, False)
        try:
            return os.read(self.far, 65536)
        except BlockingIOError:
            return b""


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Cable]:
    made = Cable(tmp_path / "ttyACM0")
    yield made
    made.unplug()


def _link(device: Path, baud: int = 57600) -> SerialLink:
    return SerialLink(address=LinkAddress("serial", device=str(device), baud=baud), back_off=QUICK)


async def test_bytes_go_both_ways_unchanged(cable: Cable, inbox: Any, wait_until: Any) -> None:
    everything = bytes(range(256))
    link = open_link(parse_link(f"serial://{cable.device}:921600"))
    box = inbox(link)
    async with link:
        cable.say(everything)
        await wait_until(lambda: len(box.data) >= 256)
        assert box.data == everything
        link.write(everything)
        got = b""

        def all_there() -> bool:
            nonlocal got
            got += cable.read()
            return len(got) >= 256

        await wait_until(all_there)
        assert got == everything
    link.write(b"closed links lose bytes and do not raise")


@pytest.mark.parametrize("baud", [57600, 921600, 123456])
def test_the_speed_is_set(cable: Cable, baud: int) -> None:
    port = open_serial_port(str(cable.device), baud)
    try:
        raw = fcntl.ioctl(port, 0x802C542A, bytes(44))
        assert struct.unpack("4IB19s2I", raw)[-1] == baud
        attributes = termios.tcgetattr(port)
        assert attributes[3] == 0  # no echo, no lines
    finally:
        os.close(port)


async def test_unplugged_and_plugged_in_again(
    cable: Cable, inbox: Any, wait_until: Any, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    link = _link(cable.device)
    box = inbox(link)
    async with link:
        cable.unplug()
        await wait_until(lambda: link.trouble != "")
        link.write(b"lost")
        await wait_until(lambda: "there is no" in link.trouble)
        cable.plug()
        await wait_until(lambda: link.trouble == "")
        cable.say(b"here again")
        await box.holds(b"here again")
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) == 2
    assert "lost" in lines[0]
    assert "back after" in lines[1]


async def test_a_port_is_ours_alone(cable: Cable) -> None:
    async with _link(cable.device):
        with pytest.raises(LinkError, match="in use by another program"):
            await _link(cable.device).__aenter__()
    async with _link(cable.device):
        pass


async def test_a_missing_device(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match=r"there is no .*ttyACM7"):
        await _link(tmp_path / "ttyACM7").__aenter__()


async def test_no_serial_port(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a port")
    with pytest.raises(LinkError, match="is not a serial port"):
        await _link(tmp_path / "file").__aenter__()


async def test_no_permission(cable: Cable, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> int:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("wil_campaign.plugins.stream_links.serial_port.os.open", refuse)
    with pytest.raises(LinkError, match="usermod -aG"):
        await _link(cable.device).__aenter__()


@pytest.mark.parametrize(
    ("number", "words"),
    [(errno.EINVAL, "does not support 9 baud"), (errno.EIO, "Input/output error")],
)
def test_other_errors_in_words(number: int, words: str) -> None:
    assert words in serial_port_remedy(OSError(number, os.strerror(number)), "/dev/ttyX", 9)


async def test_a_clogged_port_drops_late_frames(cable: Cable) -> None:
    async with _link(cable.device) as link:
        for _ in range(100):
            link.write(bytes(1000))
        assert link.dropped_writes > 0


async def test_the_wrong_speed_is_reported(cable: Cable, wait_until: Any) -> None:
    link = _link(cable.device)
    async with Driver(name="real", link=link) as driver:
        # What a faster sender looks like: framing errors and other bytes.
        cable.say(bytes(range(0, 250, 3)) * 8)
        with pytest.raises(IdentifyError, match="wrong baud rate") as caught:
            await driver.identify(0.4)
        assert "672 bytes arrived" in str(caught.value)
        assert "57600" in str(caught.value)
