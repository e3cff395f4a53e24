"""Processes of ours: started, supervised, identified and ended in one way."""
