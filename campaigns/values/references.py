"""`file.py:Name`: things of the user's; the loader stands in worlds, for recipes use it too."""

from worlds.files.references import BadReferenceError, is_reference, load_reference

__all__ = ["BadReferenceError", "is_reference", "load_reference"]
