"""How an autopilot flies: state, behaviours, setpoints, mission items, fences."""
