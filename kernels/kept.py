"""What is made from a function of the user's, and kept only as long as that."""

from collections.abc import Callable
from functools import wraps
from inspect import signature
from itertools import count
from typing import Any

import warp as wp

LOADS = count(1 << 20, 1 << 10)


def kept_by(owner: str) -> Callable:
    """As `functools.cache`, but results lie with the argument `owner`, a function of the user's, and go with it.

    A cache of our own would keep every function that a program ever trained with, and its kernels.
    """

    def decorate(make: Callable) -> Callable:
        parameters = signature(make)

        @wraps(make)
        def kept(*arguments: Any, **options: Any) -> Any:
            given = parameters.bind(*arguments, **options)
            given.apply_defaults()
            results = vars(given.arguments[owner]).setdefault("warp_neural_results", {})
            key = make, *given.arguments.values()
            if key not in results:
                results[key] = make(*arguments, **options)
                if isinstance(results[key], wp.Kernel):
                    let_go(results[key].module)
            return results[key]

        return kept

    return decorate


def let_go(module: Any) -> None:
    """Make Warp forget a module of one kernel, which it would keep until the process ends; the kernel still has it.

    Warp 1.19 finds modules by name, and tells those that use a function when it is defined anew: neither is for
    modules that one kernel has alone. On the CPU it names loaded code by module and a count of its own: with a count
    for all of them, two of one text can be loaded at once.
    """
    module.cpu_exec_id = next(LOADS)
    context = wp._src.context
    if context.user_modules.get(module.name) is module:
        del context.user_modules[module.name]
    module._detach_references()
