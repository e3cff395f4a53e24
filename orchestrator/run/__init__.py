"""One run, from starting the pair to the verdict."""
