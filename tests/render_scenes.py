"""A scene, a light and a camera for tests of the renderer."""

import numpy as np
import warp as wp
from render_materials import Glossy

from warp_neural.render import Camera, Diffuse, Environment, Scene, combine, floor, sphere

SIZE = 24, 16
GLOSSY = [[0.8, 0.5, 0.3, 0.35, 0.5, 0.5]]
CLOSE = Camera(eye=(0.0, 1.2, 5.0), target=(0.0, 1.0, 0.0), fov=20.0)  # sees nothing but a ball's middle


def ball_on_floor() -> Scene:
    return Scene([sphere(material=0, columns=64), floor(material=1)])


def lamps() -> Environment:
    """A small lamp and a large one in a dim room."""
    image = np.full((16, 32, 3), 0.2)
    image[3, 14] = 60
    image[2:7, 22:27] = 3
    return Environment(image)


def glossy_and_floor(device: wp.Device) -> object:
    """Two sets for `ball_on_floor`."""
    return combine(Glossy(GLOSSY, device), Diffuse([[0.5, 0.5, 0.5]], device=device))
