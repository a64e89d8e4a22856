"""A scene that wears a neural texture, read in different ways by one renderer.

    python -m samples.textured_scene [--texture FILE.wntc]

Runs all steps, on one texture; leaves their pictures, and the texture unless one was given.
"""

from dataclasses import dataclass, replace

from warp_neural import cli
from warp_neural.samples.textured_scene import step_01_on_sample, step_02_on_load, step_03_on_feedback


@dataclass(frozen=True, kw_only=True)
class Config(step_03_on_feedback.FeedbackConfig, step_01_on_sample.Config):
    pass


def main(config: Config) -> dict:
    metrics = {}
    for n, step in enumerate((step_01_on_sample, step_02_on_load, step_03_on_feedback)):
        metrics |= {f"step_{n + 1:02}_{name}": value for name, value in step.main(config).items()}
        config = replace(config, texture=config.texture or config.out / "tiles.wntc")
    return metrics


if __name__ == "__main__":
    cli.run(main, Config)
