"""What the plugin pytest adds to this program: nothing; pytest finds it by its entry point."""
