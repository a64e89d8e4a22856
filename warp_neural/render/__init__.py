"""`wn.render`: a path tracer for any set of materials."""

from warp_neural.render.camera import Camera
from warp_neural.render.environment import Environment
from warp_neural.render.files import load_mesh
from warp_neural.render.materials import Diffuse, combine
from warp_neural.render.mesh import Mesh
from warp_neural.render.picture import Picture
from warp_neural.render.renderer import Renderer, render
from warp_neural.render.scene import Scene
from warp_neural.render.shapes import floor, knob, sphere
from warp_neural.render.textured import Textured

__all__ = [
    "Camera",
    "Diffuse",
    "Environment",
    "Mesh",
    "Picture",
    "Renderer",
    "Scene",
    "Textured",
    "combine",
    "floor",
    "knob",
    "load_mesh",
    "render",
    "sphere",
]
