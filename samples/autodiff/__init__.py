"""Automatic differentiation: the course's examples, forwards and backwards, and what forward mode is good for."""
