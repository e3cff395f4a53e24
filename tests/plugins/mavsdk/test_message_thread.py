"""The thread of the mavsdk process that sends messages, with a library that fails; no process."""

import socket
import time
from typing import cast

from wil_campaign.foundation.processes.codec import FrameReader
from wil_campaign.plugins.mavsdk.mavsdk_library import MavsdkLibrary
from wil_campaign.plugins.mavsdk.mavsdk_process import MavsdkMessageThread, MavsdkReplySender
from wil_campaign.plugins.mavsdk.messages import MessageNotSent, SendMessage, from_process


class FailingLibrary:
    """A library that raises what it does not document."""

    def send_message(self, name: str, fields: str) -> None:
        raise ValueError("no such field")


def test_an_unexpected_exception_of_the_library_is_a_message_that_was_not_sent() -> None:
    here, there = socket.socketpair()
    with here, there:
        there.settimeout(10.0)
        messages = MavsdkMessageThread(
            cast("MavsdkLibrary", FailingLibrary()), MavsdkReplySender(here)
        )
        messages._send(SendMessage("HEARTBEAT", "{}", time.monotonic()))
        (packet,) = FrameReader().feed(there.recv(65_536))
    assert from_process.decode(packet) == MessageNotSent("HEARTBEAT", "ValueError: no such field")
