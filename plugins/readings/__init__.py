"""Readings of sensors from outside: by ZeroMQ, and from MCAP files."""
