"""The course's BRDF, directions and densities, tone mapping, texture reads."""
