"""What the plugin python adds: the functions and classes of `import wil_campaign`, by no hook."""
