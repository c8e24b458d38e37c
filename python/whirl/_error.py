"""Errors of the package itself, in the form of the program's: place, what was found, what was expected, what to do."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any, Optional

from ._whirl import Error

#: What every `Error` has; None where it is not known.
PARTS = ("file", "place", "found", "expected", "remedy", "json")

# The extension sets those that it knows; the option parser's messages have none.
for _part in PARTS:
    setattr(Error, _part, None)


class NoSuchName(Error, KeyError):
    """A name that is none of those that there are: an `Error` and a KeyError."""

    def __str__(self) -> str:
        return str(self.args[0])


def _filled(error: Error, place: Optional[str], found: str, expected: str, remedy: str) -> Error:
    error.place, error.found, error.expected, error.remedy = place, found, expected, remedy or None
    return error


def _message(place: Optional[str], found: str, expected: str, remedy: str) -> str:
    return f"{place + ': ' if place else ''}found {found}, expected {expected}{'. ' + remedy if remedy else ''}"


def bad(place: Optional[str], found: str, expected: str, remedy: str = "") -> Error:
    """``PLACE: found FOUND, expected EXPECTED. REMEDY``, with these parts."""
    return _filled(Error(_message(place, found, expected, remedy)), place, found, expected, remedy)


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """``Did you mean NAME?`` of the name that is nearest; nothing where none is near."""
    near = get_close_matches(name, list(names), 1)
    return f"Did you mean {near[0]}?" if near else ""


def no_such(place: str, name: Any, names: Iterable[str], remedy: str = "") -> Error:
    """That a name is none of ``names``, which are listed."""
    listed = list(names)
    expected = f"one of {', '.join(listed)}" if listed else "none: there are no names here"
    remedy = " ".join(filter(None, (did_you_mean(str(name), listed), remedy)))
    error = NoSuchName(_message(place, repr(name), expected, remedy))
    return _filled(error, place, repr(name), expected, remedy)


def shown(text: str, names: Mapping[str, str]) -> str:
    """A text in which temporary files stand under the names that mean something to its reader."""
    for file, name in names.items():
        text = text.replace(file, name)
    return text


def retold(error: Error, names: Mapping[str, str], remedy: Optional[str] = None) -> Error:
    """The same error without the names of temporary files, and with another remedy where one is given."""
    text = str(error)
    if remedy and error.remedy:
        text = text.replace(error.remedy, remedy)
    told = Error(shown(text, names))
    for part in PARTS:
        value = getattr(error, part)
        setattr(told, part, shown(value, names) if isinstance(value, str) else value)
    if str(error.file) in names:
        told.file = None
    if remedy:
        told.remedy = remedy
    return told
