"""Records: files, and arrays that become one."""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np

from . import _whirl
from ._error import bad, no_such, retold, shown
from ._warn import warn
from ._whirl import Error

Source = Union[str, "os.PathLike[str]", "Record", Mapping[str, Any], Any]

#: The file of arrays, in a temporary folder; its name stands in rig files that are made of it.
FILE = "in-memory.npz"
#: What stands for that file in messages and results.
IN_MEMORY = "in memory"
#: What to do where arrays have no time.
NO_TIME = 'Give a column t in s, name the one that is the time (time="clock:ms"), or say the rate in Hz: whirl.read(columns, rate=200)'
#: The same for a frame whose index has no name.
NO_TIME_IN_FRAME = ('Where the time is the frame\'s index, which has no name, give it one: df.index.name = "t"; '
                    'otherwise name the column that is the time (time="clock:ms")')


class Record:
    """A record: the file that the commands read, and its columns as arrays, read when they are first asked for.

    ``columns`` maps names to float64 arrays of shape (n,), in the units of the file; ``t`` is the time of each row in s, shape (n,), evened
    as the commands use it; ``rate`` is in Hz. Rows with NaN in a column are gaps and are not among the n; ``segments`` lists
    a slice of rows for each unbroken stretch. ``metadata`` is what one of whirl's own records carries, otherwise None.
    Reading columns raises `whirl.Error` where the file is no record.
    """

    def __init__(self, path: Union[str, "os.PathLike[str]"], *, time: Optional[str] = None, recover: bool = False,
                 resample: bool = False, folder: Optional["tempfile.TemporaryDirectory[str]"] = None) -> None:
        self.path = Path(path)
        self.time, self.recover, self.resample = time, recover, resample
        # A record that was made of arrays lives as long as this does.
        self._folder = folder
        # What to do where it has no time; arrays alone have an answer of their own.
        self._no_time: Optional[str] = None
        self._read: Optional[_whirl.Columns] = None
        self._columns: Optional[dict[str, np.ndarray]] = None

    @property
    def _file(self) -> _whirl.Columns:
        if self._read is None:
            names = names_of([self])
            try:
                self._read = _whirl.columns(self.path, self.time, self.recover, self.resample)
            except Error as error:
                raise retold(error, names, no_time(error, [self])) from None
            warn(((id, shown(text, names), advice) for id, text, advice in self._read.warnings), stacklevel=4)
        return self._read

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Every column of numbers but the time, float64, shape (n,), read-only."""
        if self._columns is None:
            file = self._file
            self._columns = {name: np.frombuffer(file.values(i)) for i, name in enumerate(file.names)}
        return self._columns

    @property
    def t(self) -> np.ndarray:
        """Time of each row, s, float64, shape (n,)."""
        return np.frombuffer(self._file.time())

    @property
    def rate(self) -> float:
        """Sampling rate, Hz."""
        return self._file.rate

    @property
    def segments(self) -> list[slice]:
        """Rows of each unbroken stretch."""
        bounds = self._file.bounds
        return [slice(start, stop) for start, stop in zip(bounds, bounds[1:])]

    @property
    def metadata(self) -> Optional[dict[str, Any]]:
        """Rig file, firmware, source, boots of one of whirl's own records."""
        text = _whirl.metadata_of(self.path)
        return None if text is None else json.loads(text)

    def to_frame(self) -> Any:
        """A pandas DataFrame of the columns with the index ``t``."""
        import pandas

        return pandas.DataFrame(self.columns, index=pandas.Index(self.t, name="t"))

    def __getitem__(self, column: str) -> np.ndarray:
        if column not in self.columns:
            raise no_such("column", column, self.columns, "The time is r.t" if column == "t" else "")
        return self.columns[column]

    def __len__(self) -> int:
        return int(self._file.bounds[-1])

    def __fspath__(self) -> str:
        return os.fspath(self.path)

    def __repr__(self) -> str:
        try:
            what = f"{len(self)} samples at {self.rate:g} Hz in {len(self.segments)} segment{'s' * (len(self.segments) != 1)}: {', '.join(self._file.names)}"
        except Error as error:
            what = f"not readable: {error}"
        return f"<whirl.Record {shown(self.path.name, names_of([self]))}: {what}>"

    def __getstate__(self) -> dict[str, Any]:
        """Without what can be read again; with the bytes of a temporary file, which is not there elsewhere."""
        state = {**self.__dict__, "_read": None, "_columns": None}
        if self._folder is not None:
            state.update(_folder=None, _bytes=self.path.read_bytes())
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        content = state.pop("_bytes", None)
        self.__dict__.update(state)
        if content is not None:
            self._folder = tempfile.TemporaryDirectory(prefix="whirl-")
            self.path = Path(self._folder.name) / self.path.name
            self.path.write_bytes(content)


def names_of(records: Sequence[Record]) -> dict[str, str]:
    """What stands for the temporary files of records that were made of arrays, whose names mean nothing to a reader."""
    names = {}
    for number, record in enumerate(records, 1):
        if record._no_time is not None:
            name = IN_MEMORY if len(records) == 1 else f"record {number}, {IN_MEMORY}"
            # As it stands, and as JSON has it.
            names.update({os.fspath(record.path): name, json.dumps(os.fspath(record.path), ensure_ascii=False)[1:-1]: name, FILE: IN_MEMORY})
    # The name alone is replaced when whole paths have been.
    return {file: names[file] for file in sorted(names, key=len, reverse=True)}


def no_time(error: Error, records: Iterable[Record]) -> Optional[str]:
    """What to do in Python where the program missed the time of arrays; None for other errors."""
    if error.place != "header" or error.expected != "a column t":
        return None
    return next((record._no_time for record in records if os.fspath(record.path) == str(error.file)), None)


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and bool(np.isfinite(float(value)))


def _unmasked(values: Any) -> Any:
    """Masked values as missing ones: NaN, or NaT among dates."""
    if not isinstance(values, np.ma.MaskedArray):
        return values
    if not np.ma.is_masked(values):
        return values.data
    kind = values.dtype.kind
    if kind not in "Mmf":
        values = values.astype(np.float64 if kind in "iu" else object)
    plain = values.data.copy()
    plain[np.ma.getmaskarray(values)] = "NaT" if kind in "Mm" else np.nan
    return plain


def _column(name: str, values: Any) -> np.ndarray:
    """Values as an array of shape (n,) of any type; (n, 1) and (1, n) are taken."""
    zoned = getattr(getattr(values, "dtype", None), "tz", None) is not None
    try:
        array = values.to_numpy(dtype="datetime64[ns]") if zoned else np.asarray(_unmasked(values))
    except ValueError:
        raise bad(f"column {name}", "rows of different lengths", "numbers of shape (n,)") from None
    if array.ndim == 0:
        raise bad(f"column {name}", f"a scalar, {array.item()!r}", "an array of shape (n,), a value for each sample", _of_a_scalar(name))
    if array.ndim == 2 and 1 in array.shape:
        return array.ravel()
    if array.ndim != 1:
        raise bad(f"column {name}", f"an array of shape {array.shape}", "shape (n,)",
                  f'Give each of its columns a name of its own, such as {{"{name}1": a[:, 0], "{name}2": a[:, 1]}}')
    return array


def _of_a_scalar(name: str) -> str:
    if name in ("fs", "rate", "dt"):
        return f"The rate in Hz is told beside the columns: whirl.read(columns, rate={'1/dt' if name == 'dt' else name})"
    return "A value that stays is np.full(n, value); leave it out where it is none of the record's columns"


def _cell(name: str, row: int, cell: Any) -> float:
    """A cell of a column of objects or texts as a number; row from 0."""
    try:
        return np.nan if cell is None else float(cell)
    except (TypeError, ValueError):
        plain = cell.item() if isinstance(cell, np.generic) else cell
        raise bad(f"sample {row + 1}, column {name}", repr(plain), "numbers",
                  'Mend the cell, or make it NaN where it is missing: pandas.to_numeric(column, errors="coerce")') from None


def _floats(name: str, values: Any, array: np.ndarray) -> np.ndarray:
    """A column of objects or texts that all read as numbers, float64; missing ones are NaN."""
    try:
        if hasattr(values, "to_numpy"):
            return np.asarray(values.to_numpy(dtype="float64", na_value=np.nan))
        return array.astype(np.float64)
    except (TypeError, ValueError):
        return np.array([_cell(name, row, cell) for row, cell in enumerate(array)])


def _array(name: str, values: Any) -> np.ndarray:
    """A column as numbers that a file can hold, shape (n,); dates become seconds from the first row."""
    array = _column(name, values)
    if array.dtype.kind in "OUST":
        array = _floats(name, values, array)
    if array.dtype.kind in "Mm":
        array = (array - array[:1]) / np.timedelta64(1, "ns") * 1e-9
    if array.dtype.kind == "f" and array.dtype.itemsize not in (4, 8):
        array = array.astype(np.float64)
    if array.dtype.kind not in "fiu":
        remedy = "Take its .real" if array.dtype.kind == "c" else "Convert it with .astype(float)"
        raise bad(f"column {name}", f"values of the type {array.dtype}", "numbers, floats or integers", remedy)
    return array


def _framed(source: Any) -> Any:
    """A frame of a frame or a series; its index is a column where it has a name."""
    if not hasattr(source, "columns") and hasattr(source, "index") and hasattr(source, "to_frame"):
        source = source.to_frame()
    if not hasattr(source, "columns"):
        remedy = {"list": "Several records are several arguments: whirl.identify(*records, rig=…)",
                  "ndarray": 'Name its columns: {"t": a[:, 0], "theta1": a[:, 1]}'}.get(type(source).__name__, "")
        raise bad("record", type(source).__name__, "a path, a Record, a dict of arrays or a DataFrame", remedy)
    name = getattr(getattr(source, "index", None), "name", None)
    if name is not None and name in source.columns:
        raise bad(f"column {name}", "it twice, as the frame's index and as a column", "it once", "Leave the index out: df.reset_index(drop=True)")
    return source if name is None else source.reset_index()


def _table(source: Any) -> dict[str, Any]:
    """Columns by name, of a mapping or of a frame; a frame's index counts where it has a name."""
    if not isinstance(source, Mapping):
        source = _framed(source)
    names = list(source) if isinstance(source, Mapping) else list(source.columns)
    called = [str(name) for name in names]
    for name in called:
        if called.count(name) > 1:
            raise bad(f"column {name}", f"{called.count(name)} columns of this name", "one", "Rename or leave out the others")
    return {str(name): source[name] for name in names}


def _unnamed_index(source: Any) -> bool:
    """Whether a frame has an index of its own making that has no name and may be the time."""
    index = None if isinstance(source, Mapping) else getattr(source, "index", None)
    return index is not None and getattr(index, "name", None) is None and type(index).__name__ != "RangeIndex"


def _arrays(columns: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Columns as arrays of one length, shape (n,) each."""
    arrays = {name: _array(name, values) for name, values in columns.items()}
    if not arrays:
        raise bad("record", "no column", "columns of numbers and the time")
    first, n = next((name, len(array)) for name, array in arrays.items())
    for name, array in arrays.items():
        if len(array) != n:
            raise bad(f"column {name}", f"{len(array)} values, {n} in {first}", "columns of one length, a value for each sample")
    if n < 2:
        raise bad("record", f"{n} row{'s' * (n != 1)}", "at least 2 rows: one sample is no motion, and has no rate")
    return arrays


def _written(columns: Mapping[str, Any], path: Path) -> None:
    """Writes columns as NumPy's archive: their values and types as they are."""
    arrays = _arrays(columns)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.ascontiguousarray(array), allow_pickle=False)


def _times(columns: Mapping[str, Any], rate: Any, start: Any) -> np.ndarray:
    """Times of the rows, s, shape (n,), of a rate in Hz."""
    for name in columns:
        if name.strip().lower() in ("t", "time"):
            raise bad("rate", f"a column {name} beside it", "one of them", "Leave one out")
    if not _is_number(rate) or rate <= 0:
        raise bad("rate", repr(rate), "a frequency above 0 Hz, a number")
    if not _is_number(start):
        raise bad("start", repr(start), "the time of the first sample in s, a number")
    n = max((np.size(values) for values in columns.values()), default=0)
    return np.asarray(float(start) + np.arange(n) / float(rate))


def read(source: Source, *, rate: Optional[float] = None, start: float = 0.0, time: Optional[str] = None, recover: bool = False,
         resample: bool = False) -> Record:
    """A record from a file (Parquet, CSV, .npz, .npy, .mat), a dict of arrays of shape (n,), or a DataFrame.

    Arrays need a column of the time, ``t`` in s or another that is called so (``time="clock:ms"`` names it), or ``rate`` in Hz, whose
    time begins at ``start`` in s. Units of columns are what the rig file says. NaN is a gap. A file is not
    opened before something asks for its columns. ``recover`` reads what is whole of a damaged file, ``resample`` makes an uneven clock even.

    Raises `whirl.Error` for arrays that are no numbers; commands raise it for a file that is no record.
    """
    if isinstance(source, Record):
        return source
    if isinstance(source, (str, os.PathLike)):
        return Record(source, time=time, recover=recover, resample=resample)
    columns = _table(source)
    if rate is not None:
        # Of several lengths the columns' own names are told, not that of the time.
        columns = {"t": _times(columns, rate, start), **_arrays(columns)}
    folder = tempfile.TemporaryDirectory(prefix="whirl-")
    path = Path(folder.name) / FILE
    _written(columns, path)
    record = Record(path, time=time, recover=recover, resample=resample, folder=folder)
    record._no_time = NO_TIME_IN_FRAME if _unnamed_index(source) else NO_TIME
    return record
