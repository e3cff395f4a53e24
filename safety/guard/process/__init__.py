"""The guard in a process of its own, and the orchestrator's side of it."""
