"""The orchestrator: one run from start to verdict, the command line, recording and results."""

if __name__ == "orchestrator":
    raise ImportError("import wil_campaign.orchestrator, not orchestrator: a module has one name")
