"""Storage that machines share without a shared folder; it transfers the results of runs."""
