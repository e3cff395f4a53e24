"""Evidence: whether the signals of a run show enough for its oracles to judge by."""
