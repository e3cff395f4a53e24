"""The search for a variant that fails: what is flown next, from what was flown so far; pure."""
