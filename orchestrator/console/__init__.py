"""The console: a page in the browser that shows what flies, and takes an operator's commands."""
