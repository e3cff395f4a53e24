"""The orchestrator: one run from start to verdict, the command line, recording and results."""
