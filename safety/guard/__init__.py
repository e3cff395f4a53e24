"""The guard: holder of the vehicle links, contingency, takeover."""
