"""Campaigns over time."""
