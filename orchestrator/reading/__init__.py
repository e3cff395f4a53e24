"""Reads results folders as far as possible, and reports what is missing or damaged."""
