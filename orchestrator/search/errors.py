"""Errors of searches."""


class SearchError(Exception):
    """A search that cannot be flown or continued; says why, and what to do."""
