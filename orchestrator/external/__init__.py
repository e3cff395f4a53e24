"""External I/O of a run: sources, image outlets, injections, and autonomy programs."""
