"""Storage that machines share without sharing a folder: the results of runs go through it."""
