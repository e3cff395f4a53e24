"""The operator's socket of a guard: requests, answers, rights."""
