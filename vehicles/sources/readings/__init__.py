"""Readings of other sensors than cameras from outside: MAVLink, ZeroMQ, recordings."""
