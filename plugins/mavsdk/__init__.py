"""The command backend that uses mavsdk, which runs in a separate process."""
