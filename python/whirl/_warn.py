"""Warnings of the commands as Python's."""

from __future__ import annotations

import warnings
from collections.abc import Iterable


class WhirlWarning(UserWarning):
    """Something that does not stop the work but that its reader must know; ``id`` is its short stable name."""

    def __init__(self, text: str, id: str) -> None:
        super().__init__(text)
        self.id = id


def warn(all: Iterable[tuple[str, str, str]], stacklevel: int) -> None:
    """Warns of each: id, text, advice."""
    for id, text, advice in all:
        warnings.warn(WhirlWarning(f"{text}. {advice}", id), stacklevel=stacklevel)
