"""Values that files and setups share; frozen, below both."""
