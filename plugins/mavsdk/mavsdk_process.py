"""The mavsdk process: reads orders and messages from its stdin, a socket to its driver.

The main thread only reads, so that it always notices the driver's exit and ends the process: no
call into mavsdk can block that. One thread sends messages, in order and never behind another
call; orders, which may block for seconds, have their own threads.
"""

import contextlib
import os
import queue
import signal
import socket
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

from wil_campaign.foundation.processes.codec import FrameReader, ProcessMessageError, framed_packet
from wil_campaign.foundation.processes.linux import UnsupportedSystemError, die_with_parent
from wil_campaign.plugins.mavsdk.mavsdk_library import MavsdkLibrary, MavsdkLibraryError
from wil_campaign.plugins.mavsdk.messages import (
    FromProcess,
    LogProgress,
    MavsdkAlive,
    MavsdkReady,
    MessageNotSent,
    Order,
    OrderExecuted,
    OrderRefused,
    SendMessage,
    from_process,
    to_process,
)

BAD_USE, FAILED = 2, 1
ALIVE_S = 0.2
"""The longest interval between two `MavsdkAlive` of the thread that sends messages."""
STALE_S = 1.0
"""A message that waited longer is not sent: setpoints are renewed, and commands repeated."""
_ORDERS = 4
_READ_BYTES = 1 << 16


class MavsdkReplySender:
    """Sends the mavsdk process's replies to the driver, from any thread."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._turn = threading.Lock()

    def send(self, message: FromProcess) -> None:
        """Send a reply of the mavsdk process; does nothing when the driver is gone."""
        try:
            with self._turn:
                self._end.sendall(framed_packet(from_process.encode(message)))
        except OSError:
            return  # The main thread notices that the driver is gone.


class MavsdkMessageThread:
    """The mavsdk process's thread that sends messages, and `MavsdkAlive` to the driver."""

    def __init__(self, library: MavsdkLibrary, replies: MavsdkReplySender) -> None:
        self._library = library
        self._replies = replies
        self._queue: queue.SimpleQueue[SendMessage] = queue.SimpleQueue()
        self._late = 0

    def queue_message(self, message: SendMessage) -> None:
        """Queue a message for the mavsdk process's sending thread."""
        self._queue.put(message)

    def run(self) -> None:
        """Send queued messages forever, in the mavsdk process's thread."""
        alive_sent_s = 0.0
        while True:
            with contextlib.suppress(queue.Empty):
                self._send(self._queue.get(timeout=ALIVE_S))
            now_s = time.monotonic()
            if now_s - alive_sent_s >= ALIVE_S / 2.0:
                alive_sent_s = now_s
                self._replies.send(MavsdkAlive(self._late))

    def _send(self, message: SendMessage) -> None:
        if time.monotonic() - message.at_s > STALE_S:
            self._late += 1
            return
        try:
            self._library.send_message(message.name, message.fields)
        except MavsdkLibraryError as error:
            self._replies.send(MessageNotSent(message.name, str(error)))
        except Exception as error:  # noqa: BLE001 - the driver has to see the reason
            self._replies.send(MessageNotSent(message.name, f"{type(error).__name__}: {error}"))


def execute_mavsdk_order(library: MavsdkLibrary, replies: MavsdkReplySender, order: Order) -> None:
    """Execute an order in the mavsdk process and reply, whatever the outcome."""
    try:
        outcome = library.execute(order, lambda part: replies.send(LogProgress(order.number, part)))
    except MavsdkLibraryError as error:
        replies.send(OrderRefused(order.number, str(error)))
    except Exception as error:  # noqa: BLE001 - the driver waits for a reply
        replies.send(OrderRefused(order.number, f"{type(error).__name__}: {error}"))
    else:
        replies.send(OrderExecuted(order.number, items=outcome.items, logs=outcome.logs))


def serve_mavsdk_driver(end: socket.socket, url: str) -> int:
    """Serve the driver until it is gone. Returns an exit code when mavsdk does not start."""
    replies = MavsdkReplySender(end)
    try:
        library = MavsdkLibrary(url)
    except MavsdkLibraryError as error:
        sys.stderr.write(f"{error}\n")
        return FAILED
    messages = MavsdkMessageThread(library, replies)
    threading.Thread(target=messages.run, name="messages", daemon=True).start()
    orders = ThreadPoolExecutor(_ORDERS, thread_name_prefix="order")
    replies.send(MavsdkReady())
    frames = FrameReader()
    while data := end.recv(_READ_BYTES):
        for packet in frames.feed(data):
            try:
                message = to_process.decode(packet)
            except ProcessMessageError as error:
                sys.stderr.write(f"{error}\n")
                continue
            if isinstance(message, SendMessage):
                messages.queue_message(message)
            else:
                orders.submit(execute_mavsdk_order, library, replies, message)
    # No orderly shutdown: a call into mavsdk that blocks would prevent the exit.
    os._exit(0)


def main(arguments: list[str]) -> int:
    """Run the mavsdk process: serve the driver on stdin; the argument is mavsdk's URL."""
    if len(arguments) != 1:
        sys.stderr.write(
            "usage: python -m wil_campaign.plugins.mavsdk URL, with a socket as stdin\n"
        )
        return BAD_USE
    try:
        # SIGKILL also ends a stopped process.
        die_with_parent(signal.SIGKILL)
    except UnsupportedSystemError as error:
        sys.stderr.write(f"{error}\n")
        return FAILED
    try:
        end = socket.socket(fileno=os.dup(sys.stdin.fileno()))
    except OSError as error:
        sys.stderr.write(f"stdin is not a socket to a driver: {error}\n")
        return BAD_USE
    end.setblocking(True)
    return serve_mavsdk_driver(end, arguments[0])
