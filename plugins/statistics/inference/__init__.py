"""Statistics in general: exact tests, correction for several tests, intervals by resampling."""
