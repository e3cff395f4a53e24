"""Example autonomies, each the system under test of a shipped campaign."""
