"""The Foxglove bridge: a separate process that sends a run in flight to Foxglove."""
