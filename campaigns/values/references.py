"""References `file.py:Name` to the user's code; the loader is in `worlds`, as recipes need it."""

from wil_campaign.foundation.files.references import BadReferenceError, is_reference, load_reference

__all__ = ["BadReferenceError", "is_reference", "load_reference"]
