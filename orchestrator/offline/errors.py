"""The one error of mixing without a flight."""


class OfflineError(Exception):
    """An offline input or output that is missing or unusable: what, where, what to do."""
