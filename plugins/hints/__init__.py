"""Hints: warnings of what is valid in the files of a campaign, but probably not meant."""
