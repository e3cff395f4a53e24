"""Flies a search: its folder and ledger, its batches by an engine, files of what failed."""
