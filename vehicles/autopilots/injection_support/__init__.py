"""Which injected messages an autopilot acts on, as it is set up; pure."""
