"""Checks between the parts of a campaign, its world and its recipe; pure."""
