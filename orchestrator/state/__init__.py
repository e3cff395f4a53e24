"""The state of one run: its setup, its stages, and its vehicles."""
