"""The error of the Foxglove bridge."""


class BridgeError(Exception):
    """A Foxglove bridge cannot be opened; the message says why, and what to do."""
