"""Steps that transform a reading: units, frames, geometry, time, colours."""
