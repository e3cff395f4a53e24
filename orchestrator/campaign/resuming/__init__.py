"""Taking up a campaign that was cut off: what was flown, what is lost, what is flown again."""
