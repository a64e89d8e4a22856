"""Device code of Warp Neural: `wp.func`s and kernels, importable into any Warp program.

No arrays, files or seeds live here. Installed, this is `warp_neural.kernels`; in a checkout `kernels` gives the very
same modules.
"""

import sys
from importlib import import_module
from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from importlib.util import find_spec


class Alias(Loader):
    """Finds the modules below `top`, a folder of a checkout, as those of `warp_neural.top`."""

    def __init__(self, top: str):
        self.prefix = f"{top}."

    def find_spec(self, name, path=None, target=None):
        real = find_spec(f"warp_neural.{name}") if name.startswith(self.prefix) else None
        package = real and real.submodule_search_locations is not None
        return real and ModuleSpec(name, self, origin=real.origin, loader_state=real, is_package=package)

    def create_module(self, spec):
        return import_module(spec.loader_state.name)

    def exec_module(self, module):  # it has run; only its spec has been replaced, as if the other name were its own
        module.__spec__ = module.__spec__.loader_state

    def get_code(self, name):  # for `python -m`
        return find_spec(f"warp_neural.{name}").loader.get_code(f"warp_neural.{name}")


if __name__ == "kernels":
    sys.meta_path.insert(0, Alias(__name__))
