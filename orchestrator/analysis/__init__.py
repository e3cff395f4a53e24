"""Analysis of flown campaigns from their results folders: statistics, gap, comparison, history."""
