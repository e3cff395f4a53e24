"""Statistics of flown campaigns: pass rates, the gap to reality, comparison, history."""
