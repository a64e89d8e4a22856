"""Neural materials for kernels: layered materials as latents and small networks, for any renderer."""

from pathlib import Path

import numpy as np
import warp as wp

from warp_neural.errors import InputError, find_device
from warp_neural.kernels.materials.neural import make_neural, make_params
from warp_neural.kernels.materials.neural_latents import LatentTexture
from warp_neural.materials.neural_file import read_neural, write_neural
from warp_neural.materials.neural_state import NeuralState
from warp_neural.nn.mlp import MLP
from warp_neural.nn.state import NetworkState


class NeuralMaterial:
    """Neural materials of one spec, on one device; what `LayeredSet` is, and called alike:

        material = load_neural("leather.wnm")
        material.evaluate(params, index, uv, lod, light, view)   # in kernels; params: material.Params

    The functions are `kernels.materials.neural.NeuralFunctions`; `params` goes to launches; `texels` are
    the sides that levels of detail count from. Any thread of any kernel
    may call them, with an index of its own, without a condition on the launch.
    """

    def __init__(self, *states: NeuralState, device: wp.DeviceLike = None):
        if not states:
            raise InputError("a set of no neural materials; give one or more")
        specs = dict.fromkeys(state.spec for state in states)
        if len(specs) > 1:
            raise InputError(
                f"neural materials of {' and of '.join(map(str, specs))}; a set has one kind: bake them alike"
            )
        self.states, self.spec, self.device = states, states[0].spec, find_device(device)
        functions = make_neural(self.spec)
        self.evaluate, self.sample, self.density = functions.evaluate, functions.sample, functions.density
        self.albedo, self.Params = functions.albedo, make_params(self.spec)
        self.networks = {name: self._network(name) for name in self.spec.networks}
        self.params = self.Params()
        for name, net in self.networks.items():
            setattr(self.params, name, net.params)
        self.params.latents = _texture(states, self.device)
        self.texels = [max(state.codes[0].shape[:2]) for state in states]

    def __len__(self) -> int:
        return len(self.states)

    def __repr__(self) -> str:
        names = ", ".join(state.source for state in self.states)
        return f"NeuralMaterial({names}; {self.spec}; {self.device.alias})"

    def save(self, path: Path | str) -> None:
        """One material as a file, whole or not at all."""
        if len(self.states) > 1:
            raise InputError(f"{path}: a file holds one neural material, and this is a set of {len(self)}")
        write_neural(path, self.states[0])

    def _network(self, name: str) -> MLP:
        """Of all materials, one after the other."""
        parameters = np.concatenate([state.networks[name].parameters for state in self.states])
        return MLP.from_state(NetworkState(self.spec.networks[name], parameters, len(self)), device=self.device)


def load_neural(*paths: Path | str, device: wp.DeviceLike = None) -> NeuralMaterial:
    """The neural materials of files, one or a set. Raises `InputError` naming the field of a damaged one."""
    return NeuralMaterial(*map(read_neural, paths), device=device)


def _texture(states: tuple[NeuralState, ...], device: wp.Device) -> LatentTexture:
    count = max(len(state.codes) for state in states)
    levels, start, texels = np.zeros((len(states), count, 3), np.int32), 0, []
    for row, state in enumerate(states):
        for level in range(count):
            codes = state.codes[min(level, len(state.codes) - 1)]
            if level < len(state.codes):
                place, start = start, start + codes.shape[0] * codes.shape[1]
                texels.append(np.ascontiguousarray(codes).view("<u4").reshape(-1, 2))
            levels[row, level] = place, *codes.shape[:2]
    texture = LatentTexture()
    texture.texels = wp.array(np.concatenate(texels).astype(np.uint32), dtype=wp.vec2ui, device=device)
    texture.levels = wp.array(levels, dtype=wp.vec3i, device=device)
    texture.scale = wp.array(np.stack([state.scale for state in states]), dtype=wp.vec2, device=device)
    return texture
