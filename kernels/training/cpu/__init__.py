"""A training step on the CPU in one kernel."""
