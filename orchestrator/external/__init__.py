"""What comes into a run from outside, and what goes out of it: opened with it, closed with it."""
