"""Mip maps that keep a material's look: the course's first half."""
