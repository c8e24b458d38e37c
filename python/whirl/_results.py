"""Answers of the commands as dataclasses that print as tables; ``json`` is the command's own JSON."""

from __future__ import annotations

import html
import json
import math
import os
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Optional, TypeVar, Union

from . import _whirl
from ._error import bad, no_such, shown
from ._whirl import Error
from ._words import words

#: Half-width of a 95 % interval, standard errors.
NORMAL_975 = 1.96

Name = Union[str, "os.PathLike[str]"]
Self = TypeVar("Self", bound="Answer")

#: Options of a file that is written of an answer that is known.
WRITTEN = ("output", "report", "ledger", "json", "force")


def show_in(report: Name, names: Mapping[str, str]) -> None:
    """Has a report name what was in memory as such, and not by a temporary file."""
    path = Path(report)
    if not names or not path.is_file():
        return
    text = path.read_text(encoding="utf-8")
    told = shown(text, {html.escape(file): name for file, name in names.items()})
    if told != text:
        _replaced(path, told)


def _number(value: Optional[float], decimals: Optional[int] = None) -> str:
    if value is None:
        return "—"
    text = f"{value:.6g}" if decimals is None else f"{value:.{decimals}f}"
    # Of -0.000 nothing is below zero.
    return text if text.strip("-0.") else text.lstrip("-")


def plus_minus(value: Optional[float], half: Optional[float]) -> str:
    """``value ± half`` with two digits of the half-width, such as ``0.0863 ± 0.0012``."""
    if value is None or half is None or not half > 0 or not math.isfinite(half):
        return _number(value)
    power = math.floor(math.log10(max(abs(value), half)))
    decimals = 1 - math.floor(math.log10(half))
    if -4 <= power <= 6:
        return f"{_number(value, max(decimals, 0))} ± {_number(half, max(decimals, 0))}"
    scale = 10.0**power
    return f"({_number(value / scale, max(decimals + power, 0))} ± {_number(half / scale, max(decimals + power, 0))})e{power}"


def _write_new(path: Path, text: str, force: bool, read: Iterable[Any]) -> None:
    """Writes a text to a file that is new, or with ``force`` none of those that the answer came from."""
    if path.exists():
        if not force:
            raise bad(os.fspath(path), "a file that is there already", "a new file", "Name another, or replace it with force=True")
        if any(one is not None and os.path.exists(one) and path.samefile(one) for one in read):
            raise bad(os.fspath(path), "a file that this answer came from", "another", "Name another output")
    try:
        _replaced(path, text)
    except OSError as error:
        raise bad(os.fspath(path), str(error.strerror), "a file that can be written", "Name one in a folder that exists") from None


def _replaced(path: Path, text: str) -> None:
    """Writes beside a file and renames, so that it is whole at any time."""
    beside = path.with_name(f".{path.name}.part")
    beside.write_text(text, encoding="utf-8")
    os.replace(beside, path)


@dataclass(frozen=True)
class Parameter:
    """A number that was found: its value and standard error, in ``unit``; either is None where it is no number."""

    name: str
    value: Optional[float]
    std_error: Optional[float]
    unit: str

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval, in ``unit``; NaN where there is none."""
        if self.value is None or self.std_error is None:
            return (math.nan, math.nan)
        half = NORMAL_975 * self.std_error
        return (self.value - half, self.value + half)

    def _cells(self) -> tuple[str, str, str]:
        half = None if self.std_error is None else NORMAL_975 * self.std_error
        return (self.name, plus_minus(self.value, half), self.unit)

    def __repr__(self) -> str:
        name, value, unit = self._cells()
        return f"{name} = {value} {unit} (95 %)"


@dataclass(frozen=True, repr=False)
class Effect(Parameter):
    """An effect that was found to be missing: ``name`` is ID@PLACE; its further parameters by name, as the JSON has them."""

    id: str
    at: str
    equation: str
    parameters: dict[str, Any]
    indistinguishable_from: tuple[str, ...]


def _parameter(of: dict[str, Any]) -> Parameter:
    return Parameter(of["name"], of["value"], of["std_error"], of["unit"])


def _effect(of: dict[str, Any]) -> Effect:
    return Effect(f"{of['id']}@{of['at']}", of["value"], of["std_error"], of["unit"], of["id"], of["at"], of["equation"],
                  of.get("parameters", {}), tuple(of.get("indistinguishable_from", ())))


class Parameters(tuple[Parameter, ...]):
    """Parameters in their order; also by name (``p["B11"]``); prints as a table of values ± 95 % with units."""

    def __getitem__(self, key: Any) -> Any:
        if not isinstance(key, str):
            return super().__getitem__(key)
        for one in self:
            if one.name == key:
                return one
        raise no_such("parameter", key, (one.name for one in self))

    def __repr__(self) -> str:
        rows = [one._cells() for one in self]
        wide = [max((len(row[i]) for row in rows), default=0) for i in range(3)]
        lines = [f"  {name:<{wide[0]}}  {value:<{wide[1]}}  {unit}" for name, value, unit in rows]
        return "\n".join(line.rstrip() for line in lines)

    def _repr_html_(self) -> str:
        cells = ["".join(f"<td>{html.escape(cell)}</td>" for cell in one._cells()) for one in self]
        rows = "".join(f"<tr>{row}</tr>" for row in cells)
        return f"<table><tr><th>parameter</th><th>value ± 95 %</th><th>unit</th></tr>{rows}</table>"


@dataclass(frozen=True, repr=False)
class Answer:
    """What a command answered.

    ``json`` is its JSON result (docs/json.md), ``json_text`` the bytes of it, ``text`` the answer for people; ``positive`` is False where
    the program would end with exit status 1, and ``reasons`` says why.
    """

    json: dict[str, Any]
    json_text: str
    text: str
    positive: bool
    reasons: tuple[str, ...]
    #: The rig file and the records of the call.
    rig: Optional[Name]
    records: tuple[Any, ...] = field(compare=False)
    #: What it is written out from; None where it was read from a pickle.
    _answer: Optional[_whirl.Answer] = field(compare=False)
    #: What stands for the temporary files of the call.
    _names: Mapping[str, str] = field(default_factory=dict, compare=False)

    def to_dict(self) -> dict[str, Any]:
        """The command's JSON result, a copy."""
        copy: dict[str, Any] = json.loads(self.json_text)
        return copy

    @property
    def _verdict(self) -> str:
        """The sentence that the answer opens with; with why it is negative where that does not say so."""
        first = self.text.strip().partition("\n")[0]
        said = self.positive or "cannot stand" in first
        return first if said else "\n".join((*self.reasons, first))

    def __repr__(self) -> str:
        return self.text.strip()

    def __copy__(self: Self) -> Self:
        return replace(self)

    def __deepcopy__(self: Self, memo: Any) -> Self:
        return replace(self, json=self.to_dict())

    def __getstate__(self) -> dict[str, Any]:
        """Without what it is written out from, which stays in its process."""
        return {**self.__dict__, "_answer": None}


@dataclass(frozen=True, repr=False)
class Kept(Answer):
    """An answer of which everything is kept that it is written out from."""

    def write(self, **options: Any) -> None:
        """Writes the files of further options of the command (``report=``, ``output=``, ``force=True`` …); nothing is computed again.

        Raises `whirl.Error` for a file that cannot be written, or that is a record and ``force`` is not given, for an option that names
        no file, and for an answer that was read from a pickle.
        """
        for name in options:
            if name not in WRITTEN:
                raise no_such("write", name, WRITTEN, "Nothing is computed again here: other options are the command's")
        if self._answer is None:
            raise bad("write", "an answer from a pickle", "one of this process: what a report is written from is not pickled",
                      "Call the command again, or write the report before")
        self._answer.write(words(options))
        if options.get("report") is not None:
            show_in(options["report"], self._names)

    def report(self, path: Name, *, force: bool = False) -> None:
        """Writes the self-contained report, HTML. Raises `whirl.Error` where it cannot be written."""
        self.write(report=path, force=force)


@dataclass(frozen=True, repr=False)
class Model(Kept):
    """An answer that is a model: it can be written, simulated and exported, also when it was read from a pickle."""

    #: The model file's text where the answer was read from a pickle.
    _model: Optional[str] = field(default=None, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_model": self._model or self._file()}

    def _file(self) -> Optional[str]:
        """The model file's text; None where there is no model."""
        with tempfile.TemporaryDirectory(prefix="whirl-") as folder:
            path = Path(folder) / "model.toml"
            try:
                self.save(path)
            except Error:
                return None
            return path.read_text(encoding="utf-8")

    @property
    def parameters(self) -> Parameters:
        """Coefficients and physical parameters, with standard errors and units."""
        return Parameters(_parameter(one) for one in self.json["parameters"])

    def __getitem__(self, name: str) -> Parameter:
        found: Parameter = self.parameters[name]
        return found

    def save(self, path: Name, *, force: bool = False) -> None:
        """Writes the model file (TOML) for `validate`, `explain` and `export`. Raises `whirl.Error` where there is no model."""
        if self._answer is not None or self._model is None:
            self.write(output=path, force=force)
        else:
            _write_new(Path(path), self._model, force, (self.rig, *self.records))

    def simulate(self, *, seconds: Optional[float] = None, initial: Any = None, from_: Any = None, start: Optional[float] = None,
                 output: Optional[Name] = None, force: bool = False, rig: Optional[Name] = None) -> Any:
        """A record of the model's motion: ``whirl simulate --model``.

        ``initial`` is the state at t = 0, shape (2 n,): n coordinates, then their rates a second, in SI units. ``from_`` is a record in whose
        state, at its time ``start`` in s, the motion begins, with its inputs and its drive's phase. ``seconds`` is the length, in s
        (default 10, with ``from_`` to its end). ``rig`` says the channels (default: the rig of this answer). Returns a `Record`.
        Raises `whirl.Error` for a model that cannot be simulated, or a state of another size.
        """
        from ._commands import simulate

        return simulate(rig or self.rig, model=self, seconds=seconds, initial=initial, from_=from_, start=start, output=output,
                        force=force)

    def export(self, to: str, output: Name, *, force: bool = False) -> None:
        """Writes the model as code: ``to`` is python, matlab, julia, c, modelica or latex. Raises `whirl.Error` where it cannot be."""
        with tempfile.TemporaryDirectory(prefix="whirl-") as folder:
            model = Path(folder) / "model.toml"
            self.save(model)
            _whirl.call(["export", *words({"to": to, "rig": self.rig, "output": output, "force": force}), "--", str(model)])


@dataclass(frozen=True, repr=False)
class Identification(Model):
    """Parameters with standard errors: the answer of `identify`."""

    @property
    def model(self) -> str:
        """Name of the model."""
        return str(self.json["model"])

    @property
    def method(self) -> str:
        """Method by which the numbers came about."""
        return str(self.json["method"])

    @property
    def identification_error(self) -> list[float]:
        """ε = ‖e‖∞/‖q̂‖∞ of each equation."""
        return list(self.json["identification_error"])

    def __repr__(self) -> str:
        used = self.json["record"]["samples"]
        return f"{self._verdict}\nIdentification of {self.model} by {self.method}, {used} samples; ± is 95 %\n{self.parameters!r}"

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self._verdict)}</p>{self.parameters._repr_html_()}"


@dataclass(frozen=True, repr=False)
class Explanation(Model):
    """Which effect is missing: the answer of `explain`."""

    @property
    def verdict(self) -> str:
        """``nothing-missing``, ``explained``, ``unexplained`` or ``not-decidable``."""
        return str(self.json["verdict"])

    @property
    def reason(self) -> str:
        """Why."""
        return str(self.json["reason"])

    @property
    def effects(self) -> Parameters:
        """The effects that were found, in the order in which they were added."""
        return Parameters(_effect(one) for one in self.json["effects"])

    @property
    def gap(self) -> dict[str, Any]:
        """Simulation minus measurement, step by step, in noise floors."""
        return dict(self.json["gap"])

    def __repr__(self) -> str:
        effects = f"\nadded; ± is 95 %\n{self.effects!r}" if self.effects else ""
        return f"{self._verdict}\n{self.verdict}: {self.reason}{effects}"


@dataclass(frozen=True, repr=False)
class Validation(Kept):
    """Whether a model moves as the measured system does: the answer of `validate`."""

    @property
    def verdict(self) -> str:
        """The verdict's name."""
        return str(self.json["verdict"])


@dataclass(frozen=True, repr=False)
class Inspection(Answer):
    """What a record shows before a model is known: the answer of `inspect`."""


@dataclass(frozen=True, repr=False)
class Reduction(Answer):
    """Modes and a reduced-order model: the answer of `reduce`."""


@dataclass(frozen=True, repr=False)
class Draft(Answer):
    """A rig file from what a record shows: the answer of `init`; ``rig`` is its path."""
