"""Simulated bad radios between guard and vehicle, by the key `links`."""
