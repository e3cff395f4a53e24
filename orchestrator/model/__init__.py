"""The model: run clock, results, exit codes, progress, operator commands, documents on disk."""
