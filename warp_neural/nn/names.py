"""What to write in place of a name: activations, losses, encodings and optimizers are objects."""

from difflib import get_close_matches
from types import ModuleType
from typing import Any

from warp_neural.errors import InputError
from warp_neural.kernels.errors import require


def require_object(name: str, value: Any, kinds: tuple[type, ...], module: ModuleType, expected: str) -> None:
    """An instance of one of `kinds`; for "relu", `wp.tanh` or a class of its instances' the error says what to write.

    module: where those are that there are.
    """
    if isinstance(value, kinds):
        return
    meant = value if isinstance(value, str) else getattr(value, "__name__", getattr(value, "key", ""))
    there = {each.lower().replace("_", ""): each for each in dir(module) if _is_one(getattr(module, each), kinds)}
    close = get_close_matches(str(meant).lower().replace("_", ""), there, n=1)
    if not close:
        require(False, name, value, f"{expected}: {', '.join(there.values())}")
    where, found = f"wn.{module.__name__.rpartition('.')[2]}", there[close[0]]
    call = "" if isinstance(getattr(module, found), kinds) else "()"
    text = repr(value) if isinstance(value, str) else meant
    raise InputError(f"{name}={text}: expected {expected}; write {where}.{found}{call}")


def _is_one(value: Any, kinds: tuple[type, ...]) -> bool:
    """An instance, or what makes one: a class, a function."""
    if isinstance(value, type):
        return issubclass(value, kinds) and (value not in kinds or len(kinds) > 1)  # no base class
    return isinstance(value, kinds) or getattr(value, "__annotations__", {}).get("return") in kinds
