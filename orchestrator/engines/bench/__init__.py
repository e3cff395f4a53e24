"""Benches of a cluster: places with real vehicles, whose own server flies what comes."""
