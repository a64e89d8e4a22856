"""Encodings as JSON: the name of the dataclass and its fields."""

from dataclasses import fields
from math import isfinite
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

from warp_neural.kernels.nn import encodings
from warp_neural.kernels.nn.encodings import Encoding


def describe_encoding(encoding: Encoding) -> dict:
    """What `make_encoding` takes, of plain values."""
    values = {field.name: _plain(getattr(encoding, field.name)) for field in fields(encoding)}
    return {"name": type(encoding).__name__, **values}


def make_encoding(description: Any) -> Encoding:
    """The encoding of a description, one of `kernels.nn.encodings`. Raises `ValueError` for any other value.

    Fields become part of C++ text, so each must be of the very type that the dataclass states.
    """
    if not isinstance(description, dict):
        raise ValueError("no JSON object")
    values = dict(description)
    name = values.pop("name", None)
    if not isinstance(name, str) or name not in encodings.__all__ or name == "Encoding":
        raise ValueError(f"{name!r} is not one of {', '.join(sorted(set(encodings.__all__) - {'Encoding'}))}")
    cls = getattr(encodings, name)
    kinds = {field.name: get_type_hints(cls)[field.name] for field in fields(cls)}
    if values.keys() != kinds.keys():
        raise ValueError(f"{name} has the fields {', '.join(kinds) or 'none'}, not {', '.join(values) or 'none'}")
    try:
        return cls(**{key: _typed(value, kinds[key], f"{name}.{key}") for key, value in values.items()})
    except (ArithmeticError, RecursionError) as error:
        raise ValueError(f"{name}: {error}") from error


def _plain(value: Any) -> Any:
    if isinstance(value, Encoding):
        return describe_encoding(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _typed(value: Any, kind: Any, where: str) -> Any:
    """`value` of JSON as the annotation `kind` has it."""
    if get_origin(kind) is UnionType:
        kind = type(None) if value is None else next(k for k in get_args(kind) if k is not type(None))
    if kind is Encoding:
        return make_encoding(value)
    if get_origin(kind) is tuple and isinstance(value, list):
        kinds = get_args(kind)
        kinds = [kinds[0]] * len(value) if kinds[-1] is ... else kinds
        if len(kinds) == len(value):
            return tuple(_typed(item, k, where) for item, k in zip(value, kinds, strict=True))
    elif kind is float and type(value) in (int, float) and isfinite(value):
        return float(value)
    elif type(value) is kind:
        return value
    raise ValueError(f"{where} is not of type {getattr(kind, '__name__', kind)}")
