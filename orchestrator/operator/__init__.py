"""Operator commands and status reports: local socket, other channels, campaign controller."""
