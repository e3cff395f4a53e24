"""Campaign files: their schema, their checks, their expansion into runs, and statistics of runs."""
