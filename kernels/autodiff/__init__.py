"""Rules of forward-mode differentiation, and `debug_grad`."""
