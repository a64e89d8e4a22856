"""The course's examples of automatic differentiation, each with its derivation and checked against it.

    python -m samples.autodiff

Runs steps 1 to 5; leaves normals.png. An example that does not come out as the lecture says ends the run.
"""

from warp_neural import cli
from warp_neural.samples.autodiff import (
    step_01_forward,
    step_02_backward,
    step_03_custom,
    step_04_debug,
    step_05_normals,
)

STEPS = (step_01_forward, step_02_backward, step_03_custom, step_04_debug, step_05_normals)


def main(config: step_05_normals.Config) -> dict:
    metrics = {}
    for step in STEPS:
        print(f"\n{step.__doc__.splitlines()[0]}\n")
        metrics |= step.main(config)
    print()
    return metrics


if __name__ == "__main__":
    cli.run(main, step_05_normals.Config)
