"""The commands as functions. Every option of the program is a keyword with the same name, meaning and check.

``from_`` stands for ``--from``, underscores for dashes, ``output`` for ``-o``; a list repeats its option, and ``map``, ``bound``, ``bifurcation`` are
dicts. Records are paths, `Record`, dicts of arrays of shape (n,), or DataFrames. All of them raise `whirl.Error` (a ValueError) with the
program's own message, warn with `whirl.WhirlWarning`, and leave the GIL free.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Optional, TypeVar, Union

from . import _whirl
from ._error import bad, retold, shown
from ._record import Record, Source, names_of, no_time, read
from ._results import (Answer, Draft, Explanation, Identification, Inspection, Model, Name, Reduction, Validation, show_in)
from ._warn import warn
from ._whirl import Error
from ._words import words

A = TypeVar("A", bound=Answer)
Map = Optional[Mapping[str, str]]
AnyModel = Union[Name, Model, None]

#: Options that name one file, and what they name.
FILES = {"rig": "the path of a rig file", "model": "the path of a model file, or an answer of identify or explain",
         "output": "the path of a file to write", "report": "the path of a file to write (.html)", "ledger": "the path of a file to write",
         "curves": "the path of a file to write"}


class Lent(str):
    """The path of a model file that is there during a call only."""


def _file(key: str, value: Any) -> Any:
    """A file's name, or an error that names the argument and what it takes."""
    if value is None or (key == "model" and isinstance(value, Model)):
        return value
    if key == "rig" and isinstance(value, Draft) and value.rig is not None:
        return value.rig
    if not isinstance(value, (str, os.PathLike)):
        remedy = 'Write the rig file\'s TOML to a file and name it: rig="rig.toml"' if key == "rig" else ""
        raise bad(key, type(value).__name__, FILES[key], remedy)
    if isinstance(value, str) and "\n" in value:
        raise bad(key, "a text of several lines", FILES[key], "Write it to a file and name that")
    return value


def _options(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """A function's arguments without its records; those it passes on stand beside the others."""
    options = {name: value for name, value in arguments.items() if name not in ("records", "balance")}
    options.update(arguments.get("balance", {}))
    return {key: _file(key, value) if key in FILES else value for key, value in options.items()}


@contextmanager
def _lent(options: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Options in which a model that is an answer is a file."""
    model = options.get("model")
    if not isinstance(model, Model):
        yield options
        return
    with tempfile.TemporaryDirectory(prefix="whirl-") as folder:
        path = Path(folder) / "model.toml"
        model.save(path)
        yield {**options, "model": Lent(path)}


def _reading(records: Sequence[Record], options: dict[str, Any]) -> dict[str, Any]:
    """Options, with how the records themselves are to be read where nothing else is said."""
    for key in ("time", "recover", "resample"):
        said = {getattr(record, key) for record in records} - {None, False}
        if key in options and not options[key] and said:
            if len(said) > 1:
                raise bad(key, ", ".join(sorted(map(str, said))), "one for all records", "Give it to the command")
            options[key] = said.pop()
    return options


def _names(records: Sequence[Record], options: Mapping[str, Any]) -> dict[str, str]:
    """What stands for the temporary files of a call."""
    further = [one for one in options.values() if isinstance(one, Record)]
    model = options.get("model")
    return {**({str(model): "the model in memory"} if isinstance(model, Lent) else {}), **names_of([*records, *further])}


def _call(command: str, records: Sequence[Record], options: Mapping[str, Any], names: Mapping[str, str]) -> _whirl.Answer:
    """Calls a command and warns; the caller's caller is told of."""
    try:
        said = _whirl.call([command, *words(options), "--", *(os.fspath(record) for record in records)])
    except Error as error:
        further = [one for one in options.values() if isinstance(one, Record)]
        raise retold(error, names, no_time(error, [*records, *further])) from None
    warn(((id, shown(text, names), advice) for id, text, advice in said.warnings), stacklevel=5)
    return said


def _at_fault(result: dict[str, Any]) -> Error:
    """The error of a record that is at fault, with the command's result."""
    error = Error(result["error"])
    error.json = result
    return error


def _answer(kind: type[A], command: str, sources: Sequence[Source], options: dict[str, Any]) -> list[A]:
    if not sources:
        raise bad("records", "none", f"at least one: whirl.{command}(record, …)")
    records = [read(source) for source in sources]
    names = _names(records, options)
    said = _call(command, records, _reading(records, options), names)
    if options.get("report") is not None:
        show_in(options["report"], names)
    whole = shown(said.json or "", names)
    result = json.loads(whole or "{}")
    if isinstance(result, dict) and isinstance(result.get("error"), str):
        raise _at_fault(result)
    several = result if isinstance(result, list) else [result]
    texts = [whole] if len(several) == 1 else [json.dumps(one) for one in several]
    reasons = tuple(shown(reason, names) for reason in said.reasons)
    return [kind(one, text, shown(said.text, names), said.positive, reasons, options.get("rig"), tuple(records), said, names)
            for one, text in zip(several, texts)]


def identify(*records: Source, rig: Optional[Name] = None, method: Optional[str] = None, window_s: Optional[float] = None,
             max_frequency_hz: Optional[float] = None, pass_hz: Optional[float] = None, segment_s: Optional[float] = None,
             bound: Optional[Mapping[str, tuple[Optional[float], Optional[float]]]] = None, time: Optional[str] = None, map: Map = None,
             recover: bool = False, resample: bool = False, from_: Optional[float] = None, to: Optional[float] = None,
             strict: bool = False, output: Optional[Name] = None, report: Optional[Name] = None, force: bool = False,
             **balance: Any) -> Identification:
    """Parameters of the equations of motion, with standard errors: ``whirl identify``.

    ``method`` is weak, shooting, frequency or upo; ``bound`` is such as ``{"C11": (0, 1)}``, None for an open side. ``from_`` and ``to`` cut
    the records, in s of their own time. ``output`` writes the model file.
    ``balance`` takes the options of harmonic balance (``piece_periods=``, ``known=``, …: ``whirl identify --help``). Names of parameters: docs/json.md.
    """
    return _answer(Identification, "identify", records, _options(locals()))[0]


def explain(*records: Source, rig: Optional[Name] = None, model: AnyModel = None, horizon: Optional[float] = None,
            forecast: Optional[Sequence[float]] = None, window_s: Optional[float] = None, max_frequency_hz: Optional[float] = None,
            pass_hz: Optional[float] = None, most_effects: Optional[int] = None, effects: Optional[Sequence[Name]] = None,
            ledger: Optional[Name] = None, time: Optional[str] = None, map: Map = None, recover: bool = False, resample: bool = False,
            from_: Optional[float] = None, to: Optional[float] = None, strict: bool = False, output: Optional[Name] = None,
            report: Optional[Name] = None, force: bool = False) -> Explanation:
    """Which physical effect the model is missing, the model with it, the gap before and after: ``whirl explain``.

    ``model`` is a model file or an answer of `identify` or `explain`. ``horizon`` and ``forecast`` are in s. ``effects`` are effect
    files to look in too. ``output`` writes the model with its effects.
    """
    with _lent(_options(locals())) as options:
        return _answer(Explanation, "explain", records, options)[0]


def validate(*records: Source, rig: Optional[Name] = None, model: AnyModel = None, free: Optional[Source] = None, tolerance_deg: Optional[float] = None, starts: Optional[int] = None,
             seed: Optional[int] = None, window_s: Optional[float] = None, bifurcation: Optional[Mapping[str, tuple[float, float]]] = None, time: Optional[str] = None,
             map: Map = None, recover: bool = False, resample: bool = False, from_: Optional[float] = None, to: Optional[float] = None,
             strict: bool = False, report: Optional[Name] = None, force: bool = False) -> Validation:
    """Whether a model moves as the measured system does: ``whirl validate``.

    ``model`` is a model file or an answer of `identify` or `explain`; ``free`` a record of free vibration; ``tolerance_deg`` in degrees.
    """
    with _lent(_options(locals())) as options:
        options["free"] = None if free is None else read(free)
        return _answer(Validation, "validate", records, options)[0]


def inspect(*records: Source, rig: Optional[Name] = None, time: Optional[str] = None, map: Map = None, recover: bool = False,
            resample: bool = False, from_: Optional[float] = None, to: Optional[float] = None, strict: bool = False,
            report: Optional[Name] = None, force: bool = False) -> Any:
    """Rates, losses, spectra, phase portraits, periodicity: ``whirl inspect``. An `Inspection`, or a list of them for several records."""
    answers = _answer(Inspection, "inspect", records, _options(locals()))
    return answers[0] if len(answers) == 1 else answers


def reduce(*records: Source, rig: Optional[Name] = None, modes: Optional[int] = None, energy: Optional[float] = None,
           constraint: Optional[str] = None, masses: Optional[Sequence[float]] = None, stream: bool = False, force: Optional[float] = None,
           force_shape: Optional[Sequence[float]] = None, damping: Optional[float] = None, curves: Optional[Name] = None,
           time: Optional[str] = None, map: Map = None, recover: bool = False, resample: bool = False, from_: Optional[float] = None,
           to: Optional[float] = None, strict: bool = False, report: Optional[Name] = None) -> Reduction:
    """Modes, a reduced-order model, its frequency–energy curve: ``whirl reduce``.

    ``constraint`` is none, type1, type2 or polar; ``force`` is here the amplitude of a force, and ``damping`` in 1/s.
    """
    return _answer(Reduction, "reduce", records, _options(locals()))[0]


def init(*records: Source, output: Name, system: Optional[str] = None, drive_hz: Optional[float] = None, time: Optional[str] = None, map: Map = None,
         recover: bool = False, force: bool = False) -> Draft:
    """Writes a commented rig file from what a record shows, to ``output``: ``whirl init``. What it guessed is in ``json`` and in the file.

    ``drive_hz`` is the drive's frequency where you know it, 0 for none.
    """
    draft = _answer(Draft, "init", records, _options(locals()))[0]
    return replace(draft, rig=output, text=_next_steps(draft.text, output))


def _next_steps(text: str, rig: Name) -> str:
    """The text of `init` with what comes next as calls of this package."""
    done, _, _ = text.partition("Next: ")
    return f'{done}Next: whirl.inspect(record, rig={os.fspath(rig)!r}), then whirl.identify(record, rig={os.fspath(rig)!r})\n'


def simulate(rig: Optional[Name] = None, *, seconds: Optional[float] = None, seed: Optional[int] = None,
             effect: Union[str, Sequence[str], None] = None, model: AnyModel = None, from_: Optional[Source] = None,
             time: Optional[str] = None, map: Map = None, start: Optional[float] = None, initial: Optional[Sequence[float]] = None,
             output: Optional[Name] = None, force: bool = False) -> Record:
    """A record of a simulated rig, or with ``model`` of an identified one: ``whirl simulate``.

    ``model`` is a model file or an answer of `identify` or `explain`. ``effect`` is such as ``"quadratic-drag@arm2=2e-6"``; ``seconds`` and ``start`` in s; ``time`` and ``map`` read ``from_``;
    ``initial`` of shape (2 n,), coordinates and then rates, SI units. Without ``output`` the record is a temporary file that lives as long as the `Record`.
    """
    options = _options(locals())
    folder = None
    if output is None:
        folder = tempfile.TemporaryDirectory(prefix="whirl-")
        options["output"] = Path(folder.name) / "simulated.parquet"
    options["from_"] = None if from_ is None else read(from_)
    with _lent(options) as lent:
        _call("simulate", (), lent if from_ is None else _reading([lent["from_"]], lent), _names((), lent))
    return Record(options["output"], folder=folder)
