"""A layered reference material: coat, specular and diffuse base, dust and fingerprints, after OpenPBR."""
