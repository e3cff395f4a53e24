"""The guard's core: bytes, positions and ticks in, bytes and events out; pure."""
