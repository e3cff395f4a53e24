"""What can go wrong with a Foxglove bridge."""


class BridgeError(Exception):
    """A Foxglove bridge that cannot be opened; says why, and what to do."""
