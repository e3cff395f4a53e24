"""Expansion of a campaign file into runs."""
