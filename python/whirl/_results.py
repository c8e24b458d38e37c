"""Answers of the commands as dataclasses that print as tables; ``json`` is the command's own JSON."""

from __future__ import annotations

import html
import json
import math
import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Optional, Union

from . import _whirl
from ._words import words

#: Half-width of a 95 % interval, standard errors.
NORMAL_975 = 1.96

Name = Union[str, "os.PathLike[str]"]


def _number(value: Optional[float], decimals: Optional[int] = None) -> str:
    if value is None:
        return "—"
    return f"{value:.6g}" if decimals is None else f"{value:.{decimals}f}"


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
        raise KeyError(key)

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
    records: tuple[Any, ...]
    _answer: _whirl.Answer = field(compare=False)

    def to_dict(self) -> dict[str, Any]:
        """The command's JSON result, a copy."""
        copy: dict[str, Any] = json.loads(self.json_text)
        return copy

    def __repr__(self) -> str:
        return "\n".join(self.text.strip().splitlines()[:12])


@dataclass(frozen=True, repr=False)
class Kept(Answer):
    """An answer of which everything is kept that it is written out from."""

    def write(self, **options: Any) -> None:
        """Writes the files of further options of the command (``report=``, ``output=``, ``force=True`` …); nothing is computed again.

        Raises `whirl.Error` for a file that cannot be written, or that is a record and ``force`` is not given.
        """
        self._answer.write(words(options))

    def report(self, path: Name, *, force: bool = False) -> None:
        """Writes the self-contained report, HTML. Raises `whirl.Error` where it cannot be written."""
        self.write(report=path, force=force)


@dataclass(frozen=True, repr=False)
class Model(Kept):
    """An answer that is a model: it can be written, simulated and exported."""

    @property
    def parameters(self) -> Parameters:
        """Coefficients and physical parameters, with standard errors and units."""
        return Parameters(_parameter(one) for one in self.json["parameters"])

    def __getitem__(self, name: str) -> Parameter:
        found: Parameter = self.parameters[name]
        return found

    def save(self, path: Name, *, force: bool = False) -> None:
        """Writes the model file (TOML) for `validate`, `explain` and `export`. Raises `whirl.Error` where there is no model."""
        self.write(output=path, force=force)

    def simulate(self, *, seconds: Optional[float] = None, initial: Any = None, from_: Any = None, start: Optional[float] = None,
                 output: Optional[Name] = None, force: bool = False, rig: Optional[Name] = None) -> Any:
        """A record of the model's motion: ``whirl simulate --model``.

        ``initial`` is the state at t = 0, shape (2 n,): n coordinates, then their rates a second, in SI units. ``from_`` is a record in whose
        state, at its time ``start`` in s, the motion begins, with its inputs and its drive's phase. ``seconds`` is the length, in s
        (default 10, with ``from_`` to its end). ``rig`` says the channels (default: the rig of this answer). Returns a `Record`.
        Raises `whirl.Error` for a model that cannot be simulated, or a state of another size.
        """
        from ._commands import simulate

        with tempfile.TemporaryDirectory(prefix="whirl-") as folder:
            model = Path(folder) / "model.toml"
            self.save(model)
            return simulate(rig or self.rig, model=model, seconds=seconds, initial=initial, from_=from_, start=start, output=output,
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
        return f"Identification of {self.model} by {self.method}, {used} samples; ± is 95 %\n{self.parameters!r}"

    def _repr_html_(self) -> str:
        return self.parameters._repr_html_()


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
        return f"{self.verdict}: {self.reason}{effects}"


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
