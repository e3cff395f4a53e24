"""The processes that fly runs: prepared, watched, ended."""
