"""Recipe files in the XML form of the paper."""
