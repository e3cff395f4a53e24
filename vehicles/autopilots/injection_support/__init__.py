"""Which injected messages an autopilot acts on, with its present parameters; pure."""
