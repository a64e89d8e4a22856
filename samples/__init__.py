"""One package per course section; `python -m samples.SECTION` runs its main job."""
