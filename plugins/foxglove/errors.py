"""The error of the Foxglove bridge."""

from wil_campaign.hooks import LiveViewError


class BridgeError(LiveViewError):
    """A Foxglove bridge cannot be opened; the message says why, and what to do."""

    code = 2
