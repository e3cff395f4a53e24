"""The report: one page of a campaign that needs nothing beside it, made from its results folder."""
