"""The report of a search: its page, with plots of its parameter space and its coverage."""
