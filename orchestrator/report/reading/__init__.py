"""Reads a results folder into the reading model; what cannot be read becomes a problem in words."""
