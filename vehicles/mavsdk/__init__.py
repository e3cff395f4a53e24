"""A driver's voice by mavsdk, which runs in a process of its own."""
