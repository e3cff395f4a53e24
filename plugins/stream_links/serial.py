"""Serial links: a radio or an autopilot's USB port, reopened after it was unplugged."""

import asyncio
import errno
import os
from typing import Self

from wil_campaign.plugins.stream_links.reconnection import BackOff, Reconnection
from wil_campaign.plugins.stream_links.serial_port import open_serial_port, serial_port_remedy
from wil_campaign.vehicles.links.link import LinkError, ReceivingLink
from wil_campaign.vehicles.links.link_factory import LinkRequest
from wil_campaign.vehicles.links.link_strings import LinkAddress

_AT_ONCE = 4096
_MOST_WAITING_BYTES = 4096
"""0.7 s of a radio at 57600 baud: writes beyond that are dropped."""


class SerialLink(ReceivingLink):
    """A serial port as a link, 8N1 without flow control; wall clock only.

    The port is opened exclusively. When it vanishes it is reopened by its name; a name in
    /dev/serial/by-id stays the same when the device is plugged in again.
    """

    def __init__(self, *, address: LinkAddress, back_off: BackOff | None = None) -> None:
        self._address = address
        self._loop: asyncio.AbstractEventLoop | None = None
        self._port: int | None = None
        self._waiting = bytearray()
        self.dropped_writes = 0
        self._recovery = Reconnection(
            name=self.name, reconnect=self._reopen, back_off=back_off or BackOff()
        )

    @property
    def name(self) -> str:
        """Return the serial link's link string."""
        return str(self._address)

    @property
    def trouble(self) -> str:
        """Return why the serial port is lost; empty while it is open."""
        return self._recovery.trouble

    def write(self, data: bytes) -> None:
        """Send bytes on the serial port, unless it is gone or clogged."""
        if self._port is None or self._loop is None:
            return
        if len(self._waiting) > _MOST_WAITING_BYTES:
            self.dropped_writes += 1
            return
        idle = not self._waiting
        self._waiting += data
        if idle:
            self._send()

    async def __aenter__(self) -> Self:
        """Open the serial port. Raises LinkError, which says what to do."""
        self._loop = asyncio.get_running_loop()
        self._open(self._loop)
        return self

    async def __aexit__(self, *_: object) -> None:
        """Close the serial port."""
        self._receiver = None
        await self._recovery.stop()
        self._close()

    async def _reopen(self) -> None:
        if self._loop is not None:
            self._open(self._loop)

    def _open(self, loop: asyncio.AbstractEventLoop) -> None:
        device, baud = self._address.device, self._address.baud
        try:
            self._port = open_serial_port(device, baud)
        except OSError as error:
            raise LinkError(f"{self.name}: {serial_port_remedy(error, device, baud)}") from error
        self._waiting.clear()
        loop.add_reader(self._port, self._read)

    def _close(self) -> None:
        port, self._port = self._port, None
        if port is not None and self._loop is not None:
            self._loop.remove_reader(port)
            self._loop.remove_writer(port)
            os.close(port)

    def _read(self) -> None:
        if self._port is None or self._loop is None:
            return
        try:
            data = os.read(self._port, _AT_ONCE)
        except BlockingIOError:
            return
        except OSError as error:
            self._on_lost(error)
            return
        if not data:
            self._on_lost(OSError(errno.EIO, "the device was unplugged"))
        elif self._receiver is not None:
            self._receiver(data, self._loop.time())

    def _send(self) -> None:
        if self._port is None or self._loop is None:
            return
        try:
            sent = os.write(self._port, self._waiting)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            self._on_lost(error)
            return
        del self._waiting[:sent]
        if self._waiting:
            self._loop.add_writer(self._port, self._send)
        else:
            self._loop.remove_writer(self._port)

    def _on_lost(self, error: OSError) -> None:
        self._close()
        self._recovery.lost(error.strerror or str(error))


def serial_link(request: LinkRequest) -> SerialLink:
    """Return the serial link that is asked for."""
    return SerialLink(address=request.address)
