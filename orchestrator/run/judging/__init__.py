"""What a run is judged by: its oracles, their evidence, and the outcome."""
