"""The formats of mesh files: each read part by part, with its materials, or refused by name."""
