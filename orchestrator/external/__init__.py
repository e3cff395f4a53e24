"""External I/O of a run: its sources, and what plugins observe of it."""
