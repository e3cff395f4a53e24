"""Reads results folders: what can be read is, and what cannot is named."""
