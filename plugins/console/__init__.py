"""The console: a web page that shows runs in flight, and takes an operator's commands."""
