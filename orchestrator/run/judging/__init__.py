"""Oracle evaluation of a run: its oracles, their evidence, and the outcome."""
