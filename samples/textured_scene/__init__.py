"""A plane and a sphere that wear a neural texture, read by one texel a pixel."""
