"""Event loops: virtual time, a paced clock that follows a simulation, sleeping to a time."""
