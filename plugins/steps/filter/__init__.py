"""Steps that keep a part of a reading."""
