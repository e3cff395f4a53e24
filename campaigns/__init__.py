"""Campaign files: what they may say, their expansion into runs, and statistics over runs."""
