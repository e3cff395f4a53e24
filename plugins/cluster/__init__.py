"""Flies the runs of a campaign on other machines, by Ray, and on benches there."""
