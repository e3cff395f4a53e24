"""The report: one self-contained HTML page of a campaign, made from its results folder."""
