"""A campaign's folder: who uses it, what is in it, and what its runs rest on."""
