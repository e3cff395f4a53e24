"""The model: the run clock, results, progress, operators' commands, documents on disk."""
