"""Oracles: the checks that a campaign may name, a file each; `registry` has them by name."""
