"""A scene that wears a neural texture, read in different ways by one renderer.

    python -m samples.textured_scene [--texture FILE.wntc]

Runs all steps, so far the first; leaves their pictures, and the texture unless one was given.
"""

from warp_neural import cli
from warp_neural.samples.textured_scene import step_01_on_sample

if __name__ == "__main__":
    cli.run(step_01_on_sample.main, step_01_on_sample.Config)
