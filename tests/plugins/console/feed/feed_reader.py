"""A console in this process that reads live feeds, for tests of what is published."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from wil_campaign.plugins.console.feed.feed_messages import FeedMessage, feed_codec
from wil_campaign.plugins.console.feed.feed_sockets import feed_receiver


@contextmanager
def reading_feed() -> Iterator[list[FeedMessage]]:
    """Read all feeds of this user until the context is left."""
    found: list[FeedMessage] = []
    with feed_receiver() as end:
        end.settimeout(0.1)
        is_over = threading.Event()

        def read() -> None:
            while True:
                try:
                    found.append(feed_codec.decode(end.recv(1 << 18)))
                except TimeoutError:
                    if is_over.is_set():
                        return  # nothing is left, either

        reader = threading.Thread(target=read)
        reader.start()
        try:
            yield found
        finally:
            is_over.set()
            reader.join()
