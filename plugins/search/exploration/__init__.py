"""The search for a variant that fails: which flights come next, given all flights so far; pure."""
