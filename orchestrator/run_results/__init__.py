"""Results of runs and campaigns: their fields, acceptance and exit code, texts about them."""
