"""Statistics of flights: proportions, exact tests, intervals by resampling, sequential tests."""
