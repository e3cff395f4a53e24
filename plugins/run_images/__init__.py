"""Pictures of a run to share: one of its moment, and a moving one of its flight."""
