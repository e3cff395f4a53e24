"""Files: YAML documents with the place of every value, faults, and references to user code."""
