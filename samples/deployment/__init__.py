"""A network that was trained in Python, in programs without it."""
