"""`wn.config`: what holds for the whole process."""

from functools import wraps
from typing import Any

import warp as wp

from warp_neural.errors import InputError
from warp_neural.kernels.nn.spec import Parameters

Struct = type(Parameters)


class Config:
    """verify: whether every launch, of any kernel, looks at all its structs: that they are of the types that the kernel
    takes, and their arrays on the device of the launch. Warp 1.19 reads whatever lies there. Raises `InputError`; costs
    about a microsecond a launch. To find a mistake; off by default. Parameters of networks are of the right type with
    it or without: that look is free, and without it an array in their place ends the process.
    """

    def __init__(self) -> None:
        self.verify = False
        wp._src.context.pack_arg = self.checked(wp._src.context.pack_arg)

    def checked(self, pack: Any) -> Any:
        """Warp's function that turns an argument of a launch into bytes, after a look at the argument."""

        @wraps(pack)
        def pack_arg(kernel, arg_type, arg_name, value, device, adjoint=False):
            if isinstance(arg_type, Struct):
                name = f"{kernel.key}: {arg_name}"
                if self.verify or issubclass(arg_type.cls, Parameters.cls):
                    check_type(name, arg_type, value)
                if self.verify:
                    check_device(name, arg_type, value, wp.get_device(device))
            return pack(kernel, arg_type, arg_name, value, device, adjoint)

        return pack_arg


def check_type(name: str, expected: Any, value: Any) -> None:
    given = getattr(value, "_cls", None)
    if given is not expected:
        given = given.key if given else type(value).__name__
        raise InputError(f"{name} is a {given}, and the kernel takes a {expected.key}; launch it with one")


def check_device(name: str, struct: Any, value: Any, device: wp.Device) -> None:
    for member in struct.vars:
        array = getattr(value, member)
        if isinstance(array, wp.array) and array.size and array.device != device and not array.pinned:
            raise InputError(f"{name}.{member} is on {array.device.alias}, the launch on {device.alias}")


config = Config()
