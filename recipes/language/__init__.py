"""The recipe language: YAML and the paper's XML, read into checked recipes."""
