"""Visibility: whether a mixture shows the virtual objects, measured in the mixture itself."""
