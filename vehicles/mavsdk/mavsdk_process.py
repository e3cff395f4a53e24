"""The process that speaks by mavsdk: told what by its stdin, a socket to its driver.

The main thread reads and nothing else, so that the driver's end is always seen, and ends all: no
call into mavsdk can keep it. One thread says messages, in their order and never behind another
call; orders, which may block for seconds, have threads of their own.
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

from vehicles.mavsdk.mavsdk_library import LibraryError, MavsdkLibrary
from vehicles.mavsdk.messages import (
    Alive,
    Done,
    FromProcess,
    NotSent,
    Order,
    Progress,
    Ready,
    Refused,
    SendMessage,
    from_process,
    to_process,
)
from vehicles.processes.codec import FrameReader, MessageError, framed
from vehicles.processes.linux import UnsupportedSystemError, die_with_parent

BAD_USE, FAILED = 2, 1
ALIVE_S = 0.2
"""How often the thread that says messages gives a sign, and less seldom with each message."""
STALE_S = 1.0
"""A message that waited longer is not said: setpoints are renewed, and commands said again."""
_ORDERS = 4
_READ_BYTES = 1 << 16


class AnswerSender:
    """Sends the mavsdk process's replies to the driver, from any thread."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._turn = threading.Lock()

    def send(self, message: FromProcess) -> None:
        """Send a reply of the mavsdk process; nothing when the driver is gone."""
        try:
            with self._turn:
                self._end.sendall(framed(from_process.encode(message)))
        except OSError:
            return  # The main thread finds the end.


class Speaker:
    """The mavsdk process's thread that sends messages, and its signs of life."""

    def __init__(self, library: MavsdkLibrary, answers: AnswerSender) -> None:
        self._library = library
        self._answers = answers
        self._queue: queue.SimpleQueue[SendMessage] = queue.SimpleQueue()
        self._late = 0

    def say(self, message: SendMessage) -> None:
        """Queue a message for the mavsdk process's sending thread."""
        self._queue.put(message)

    def run(self) -> None:
        """Send queued messages for good, in the mavsdk process's thread."""
        shown_s = 0.0
        while True:
            with contextlib.suppress(queue.Empty):
                self._send(self._queue.get(timeout=ALIVE_S))
            now_s = time.monotonic()
            if now_s - shown_s >= ALIVE_S / 2.0:
                shown_s = now_s
                self._answers.send(Alive(self._late))

    def _send(self, message: SendMessage) -> None:
        """Send a message by mavsdk, unless it is stale."""
        if time.monotonic() - message.at_s > STALE_S:
            self._late += 1
            return
        try:
            self._library.say(message.name, message.fields)
        except LibraryError as error:
            self._answers.send(NotSent(message.name, str(error)))


def obey(library: MavsdkLibrary, answers: AnswerSender, order: Order) -> None:
    """Execute an order in the mavsdk process and reply, whatever the outcome."""
    try:
        done = library.obey(order, lambda part: answers.send(Progress(order.number, part)))
    except LibraryError as error:
        answers.send(Refused(order.number, str(error)))
    except Exception as error:  # noqa: BLE001 - whoever waits for the answer is told, not left
        answers.send(Refused(order.number, f"{type(error).__name__}: {error}"))
    else:
        answers.send(Done(order.number, items=done.items, logs=done.logs))


def serve(end: socket.socket, url: str) -> int:
    """Serve the driver until it is gone. Returns an exit code when mavsdk does not start."""
    answers = AnswerSender(end)
    try:
        library = MavsdkLibrary(url)
    except LibraryError as error:
        sys.stderr.write(f"{error}\n")
        return FAILED
    speaker = Speaker(library, answers)
    threading.Thread(target=speaker.run, name="speaker", daemon=True).start()
    orders = ThreadPoolExecutor(_ORDERS, thread_name_prefix="order")
    answers.send(Ready())
    frames = FrameReader()
    while data := end.recv(_READ_BYTES):
        for packet in frames.feed(data):
            try:
                message = to_process.decode(packet)
            except MessageError as error:
                sys.stderr.write(f"{error}\n")
                continue
            if isinstance(message, SendMessage):
                speaker.say(message)
            else:
                orders.submit(obey, library, answers, message)
    # Nothing is torn down in order: a call that blocks would keep us.
    os._exit(0)


def main(arguments: list[str]) -> int:
    """Run the mavsdk process: serve the driver on stdin; the argument is mavsdk's URL."""
    if len(arguments) != 1:
        sys.stderr.write("usage: python -m vehicles.mavsdk URL, with a socket as stdin\n")
        return BAD_USE
    try:
        # Also while we are stopped.
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
    return serve(end, arguments[0])
