"""Campaigns and mock vehicles in tests of pytest."""
