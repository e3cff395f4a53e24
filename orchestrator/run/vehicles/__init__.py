"""The vehicles of a run: started, guarded, checked and configured before they arm."""
