"""The search for variants that fail: proposes, flies by an engine, writes files of failures."""
