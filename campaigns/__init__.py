"""Campaign files: their schema, their checks, their expansion into runs, and statistics of runs."""

if __name__ == "campaigns":
    raise ImportError("import wil_campaign.campaigns, not campaigns: a module has one name")
