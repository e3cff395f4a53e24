"""What flown campaigns show, from their results folders: statistics, gap, comparison, history."""
