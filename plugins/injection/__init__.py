"""Injection: messages of a run, made of mixed readings, objects and poses, for the autopilots."""
