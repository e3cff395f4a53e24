"""The built-in steps; importing this package registers them."""

from recipes.steps import geometry, isolation, overlays, registration

__all__ = ["geometry", "isolation", "overlays", "registration"]
