"""A fixed camera that looks at the world from outside: pictures and films of recorded runs."""
