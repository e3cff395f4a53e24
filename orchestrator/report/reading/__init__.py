"""Reads a run of a results folder into the reading model; what is unreadable becomes a problem."""
