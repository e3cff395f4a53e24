"""Benches of a cluster: places with real vehicles, where the bench's own server flies runs."""
