"""Resuming an interrupted campaign: which runs are finished, lost, or flown again."""
