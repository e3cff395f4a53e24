"""Signal temporal logic over the signals of a run: our reading of formulas, rtamt's semantics."""
