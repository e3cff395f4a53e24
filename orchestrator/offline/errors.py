"""The one error of mixing without a flight."""


class OfflineError(Exception):
    """An input or output that cannot be had or used: what, where, what to do."""
