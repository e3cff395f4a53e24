"""A campaign's folder: its lock, its manifest, and the files that its runs read."""
