"""Keyword arguments as the words of whirl's command line."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ._error import bad


def _text(value: Any) -> str:
    """A value as one word; numbers in the shortest digits that read back to the same binary64."""
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float):
        return repr(float(value))
    if value is np.ma.masked:
        raise bad(None, "a masked value among the options", "numbers")
    item = getattr(value, "item", None)
    return _text(item()) if item is not None else str(value)


def _pair(name: str, value: Any) -> str:
    """NAME=VALUE, or NAME=LOW:HIGH of a pair; a side that is None stays open."""
    if isinstance(value, (tuple, list)):
        value = ":".join("" if side is None else _text(side) for side in value)
    return f"{name}={_text(value)}"


def _values(value: Any) -> list[str]:
    if isinstance(value, Mapping):
        return [_pair(name, of) for name, of in value.items()]
    if isinstance(value, Iterable) and not isinstance(value, (str, os.PathLike)):
        return [_text(one) for one in value]
    return [_text(value)]


def words(options: Mapping[str, Any]) -> list[str]:
    """Options as words: None and False are left out, True is a switch, a list repeats its option, a dict gives NAME=VALUE each.

    ``from_`` is ``--from``, ``window_s`` is ``--window-s``, ``output`` is ``-o``.
    """
    out: list[str] = []
    for key, value in options.items():
        if value is None or value is False:
            continue
        option = "-o" if key == "output" else "--" + key.rstrip("_").replace("_", "-")
        if value is True:
            out.append(option)
            continue
        for one in _values(value):
            # One word, so that a value may begin with a dash.
            out.append(f"{option}{one}" if option == "-o" else f"{option}={one}")
    return out
