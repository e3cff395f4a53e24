"""Errors of reading results folders."""


class ResultsFolderError(Exception):
    """A folder is not the results folder of a campaign; the message says what to give instead."""
