"""Flies a campaign: worker processes, folders, resumption, what is between runs."""
