"""Setups: what one run needs, resolved from its files."""
