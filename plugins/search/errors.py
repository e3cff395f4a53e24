"""Errors of searches."""


class SearchError(Exception):
    """A search cannot be flown or continued; says why, and the remedy."""
