"""The start of a campaign: files to begin with, and JSON Schemas for editors."""
