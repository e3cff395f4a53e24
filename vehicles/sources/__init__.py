"""Pictures and poses from outside: live cameras, recordings, simulators, motion capture."""
