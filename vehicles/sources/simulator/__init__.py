"""Images from a simulator in another process, and the protocol for it."""
