"""Options of a JSON object: defaults, types, and one line of error for what is not understood."""

from difflib import get_close_matches
from typing import Any

from warp_neural.errors import InputError


class Options:
    """Takes the options of one object, case-insensitive in names of choices as tiny-cuda-nn; `end` refuses the rest."""

    def __init__(self, where: str, config: dict):
        if not isinstance(config, dict):
            raise InputError(f"{where}: {type(config).__name__}; expected a dictionary, as of tiny-cuda-nn's JSON")
        self.where, self.left, self.known = where, dict(config), []

    def choice(self, name: str, choices: dict[str, Any], refused: dict[str, str], default: str | None = None) -> Any:
        """What `choices` has for the option; `refused`: for names that are understood, what to give instead."""
        self.known.append(name)
        value = self.left.pop(name, default)
        if value is None:
            raise InputError(f"{self.where}: no {name!r}; give one of {', '.join(choices)}")
        for key, result in choices.items():
            if str(value).lower() == key.lower():
                return result
        for key, instead in refused.items():
            if str(value).lower() == key.lower():
                raise InputError(f"{self.where}: {name} {key!r} is not supported; {instead}")
        near = get_close_matches(str(value), [*choices, *refused], n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"give one of {', '.join(choices)}"
        raise InputError(f"{self.where}: unknown {name} {value!r}; {hint}")

    def whole(self, name: str, default: int, low: int = 1) -> int:
        self.known.append(name)
        value = self.left.pop(name, default)
        if type(value) is not int or value < low:
            raise InputError(f"{self.where}: {name}={value!r}; expected a whole number >= {low}")
        return value

    def real(self, name: str, default: float) -> float:
        self.known.append(name)
        value = self.left.pop(name, default)
        if type(value) not in (int, float):
            raise InputError(f"{self.where}: {name}={value!r}; expected a number")
        return float(value)

    def flag(self, name: str) -> bool:
        self.known.append(name)
        value = self.left.pop(name, False)
        if type(value) is not bool:
            raise InputError(f"{self.where}: {name}={value!r}; expected true or false")
        return value

    def end(self) -> None:
        """Raise `InputError` for an option that nobody took."""
        for name in self.left:
            near = get_close_matches(str(name), self.known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(self.known)}"
            raise InputError(f"{self.where}: unknown option {name!r}; {hint}")
