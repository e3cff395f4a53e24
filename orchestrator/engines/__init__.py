"""Engines that fly the runs of a campaign on other machines."""
