"""Redundant links to one vehicle, by the key `spare_links`."""
