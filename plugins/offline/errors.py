"""The error of mixing without a flight."""


class OfflineError(Exception):
    """An input or output file is missing or unusable; the message says which, and what to do."""
