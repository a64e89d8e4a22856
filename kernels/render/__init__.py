"""A path tracer's parts: what rays hit, light from afar, the camera, materials, and paths through them."""
