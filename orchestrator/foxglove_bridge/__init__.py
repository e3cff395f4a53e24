"""The Foxglove bridge: what flies, live for Foxglove, by a process of its own that only sends."""
