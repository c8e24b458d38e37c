"""The commands as functions. Every option of the program is a keyword with the same name, meaning and check.

``from_`` stands for ``--from``, underscores for dashes, ``output`` for ``-o``; a list repeats its option, and ``map``, ``bound``, ``bifurcation`` are
dicts. Records are paths, `Record`, dicts of arrays of shape (n,), or DataFrames. All of them raise `whirl.Error` (a ValueError) with the
program's own message, warn with `whirl.WhirlWarning`, and leave the GIL free.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Optional, TypeVar, Union

from . import _whirl
from ._record import Record, Source, read
from ._results import (Answer, Draft, Explanation, Identification, Inspection, Name, Reduction, Validation)
from ._warn import warn
from ._whirl import Error
from ._words import words

A = TypeVar("A", bound=Answer)
Map = Optional[Mapping[str, str]]


def _options(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """A function's arguments without its records; those it passes on stand beside the others."""
    options = {name: value for name, value in arguments.items() if name not in ("records", "balance")}
    return {**options, **arguments.get("balance", {})}


def _reading(records: Sequence[Record], options: dict[str, Any]) -> dict[str, Any]:
    """Options, with how the records themselves are to be read where nothing else is said."""
    for key in ("time", "recover", "resample"):
        said = {getattr(record, key) for record in records} - {None, False}
        if key in options and not options[key] and said:
            if len(said) > 1:
                raise Error(f"{key}: found {', '.join(map(str, said))}, expected one for all records")
            options[key] = said.pop()
    return options


def _call(command: str, files: Sequence[Any], options: Mapping[str, Any]) -> _whirl.Answer:
    """Calls a command, warns, and raises where the record was at fault; the caller's caller is told of."""
    said = _whirl.call([command, *words(options), "--", *(os.fspath(file) for file in files)])
    warn(said.warnings, stacklevel=5)
    return said


def _answer(kind: type[A], command: str, sources: Sequence[Source], options: dict[str, Any]) -> list[A]:
    records = [read(source) for source in sources]
    said = _call(command, records, _reading(records, options))
    result = json.loads(said.json or "{}")
    if isinstance(result, dict) and isinstance(result.get("error"), str):
        error = Error(result["error"])
        error.json = result  # type: ignore[attr-defined]
        raise error
    several = result if isinstance(result, list) else [result]
    texts = [said.json or ""] if len(several) == 1 else [json.dumps(one) for one in several]
    return [kind(one, text, said.text, said.positive, tuple(said.reasons), options.get("rig"), tuple(records), said)
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


def explain(*records: Source, rig: Optional[Name] = None, model: Optional[Name] = None, horizon: Optional[float] = None,
            forecast: Optional[Sequence[float]] = None, window_s: Optional[float] = None, max_frequency_hz: Optional[float] = None,
            pass_hz: Optional[float] = None, most_effects: Optional[int] = None, effects: Optional[Sequence[Name]] = None,
            ledger: Optional[Name] = None, time: Optional[str] = None, map: Map = None, recover: bool = False, resample: bool = False,
            from_: Optional[float] = None, to: Optional[float] = None, strict: bool = False, output: Optional[Name] = None,
            report: Optional[Name] = None, force: bool = False) -> Explanation:
    """Which physical effect the model is missing, the model with it, the gap before and after: ``whirl explain``.

    ``horizon`` and ``forecast`` are in s. ``effects`` are effect files to look in too. ``output`` writes the model with its effects.
    """
    return _answer(Explanation, "explain", records, _options(locals()))[0]


def validate(*records: Source, rig: Optional[Name] = None, model: Union[Name, Identification, Explanation, None] = None,
             free: Optional[Source] = None, tolerance_deg: Optional[float] = None, starts: Optional[int] = None,
             seed: Optional[int] = None, bifurcation: Optional[Mapping[str, tuple[float, float]]] = None, time: Optional[str] = None,
             map: Map = None, recover: bool = False, resample: bool = False, from_: Optional[float] = None, to: Optional[float] = None,
             strict: bool = False, report: Optional[Name] = None, force: bool = False) -> Validation:
    """Whether a model moves as the measured system does: ``whirl validate``.

    ``model`` is a model file or an answer of `identify` or `explain`; ``free`` a record of free vibration; ``tolerance_deg`` in degrees.
    """
    options = _options(locals())
    with tempfile.TemporaryDirectory(prefix="whirl-") as folder:
        if isinstance(model, (Identification, Explanation)):
            options["model"] = Path(folder) / "model.toml"
            model.save(options["model"])
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
    return _answer(Draft, "init", records, {**_options(locals()), "rig": None})[0]


def simulate(rig: Optional[Name] = None, *, seconds: Optional[float] = None, seed: Optional[int] = None,
             effect: Union[str, Sequence[str], None] = None, model: Optional[Name] = None, from_: Optional[Source] = None,
             time: Optional[str] = None, map: Map = None, start: Optional[float] = None, initial: Optional[Sequence[float]] = None,
             output: Optional[Name] = None, force: bool = False) -> Record:
    """A record of a simulated rig, or with ``model`` of an identified one: ``whirl simulate``.

    ``effect`` is such as ``"quadratic-drag@arm2=2e-6"``; ``seconds`` and ``start`` in s; ``time`` and ``map`` read ``from_``;
    ``initial`` of shape (2 n,), coordinates and then rates, SI units. Without ``output`` the record is a temporary file that lives as long as the `Record`.
    """
    options = _options(locals())
    folder = None
    if output is None:
        folder = tempfile.TemporaryDirectory(prefix="whirl-")
        options["output"] = Path(folder.name) / "simulated.parquet"
    options["from_"] = None if from_ is None else read(from_)
    _call("simulate", (), options if from_ is None else _reading([options["from_"]], options))
    return Record(options["output"], folder=folder)
