"""Records: files, and arrays that become one."""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np

from . import _whirl
from ._whirl import Error
from ._warn import warn

Source = Union[str, "os.PathLike[str]", "Record", Mapping[str, Any], Any]


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
        self._read: Optional[_whirl.Columns] = None
        self._columns: Optional[dict[str, np.ndarray]] = None

    @property
    def _file(self) -> _whirl.Columns:
        if self._read is None:
            self._read = _whirl.columns(self.path, self.time, self.recover, self.resample)
            warn(self._read.warnings, stacklevel=4)
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
        return f"<whirl.Record {self.path.name}: {what}>"


def _array(name: str, values: Any) -> np.ndarray:
    """A column as numbers that a file can hold; dates become seconds from the first row."""
    array = np.asarray(values)
    if array.dtype.kind == "O" and hasattr(values, "to_numpy"):
        try:
            array = values.to_numpy(dtype="float64", na_value=np.nan)
        except (TypeError, ValueError):
            pass
    if array.dtype.kind in "Mm":
        array = (array - array[:1]) / np.timedelta64(1, "ns") * 1e-9
    if array.dtype.kind == "f" and array.dtype.itemsize not in (4, 8):
        array = array.astype(np.float64)
    if array.ndim != 1 or array.dtype.kind not in "fiu":
        raise Error(f"column {name}: found an array of shape {array.shape} and type {array.dtype}, "
                    "expected numbers of shape (n,). Convert it with .astype(float)")
    return array


def _table(source: Any) -> dict[str, Any]:
    """Columns by name, of a mapping or of a frame; a frame's index counts where it has a name."""
    if isinstance(source, Mapping):
        return {str(name): values for name, values in source.items()}
    if getattr(getattr(source, "index", None), "name", None) is not None:
        source = source.reset_index()
    if not hasattr(source, "columns"):
        raise Error(f"found {type(source).__name__}, expected a path, a Record, a dict of arrays or a DataFrame")
    return {str(name): source[name] for name in source.columns}


def _written(columns: Mapping[str, Any], path: Path) -> None:
    """Writes columns as NumPy's archive: their values and types as they are."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        for name, values in columns.items():
            array = np.ascontiguousarray(_array(name, values))
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)


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
        if "t" in columns:
            raise Error("rate: found a column t beside it, expected one of them. Leave one out")
        if not (np.isfinite(rate) and rate > 0):
            raise Error(f"rate: found {rate}, expected a frequency above 0 Hz")
        n = max((len(values) for values in columns.values()), default=0)
        columns = {"t": start + np.arange(n) / rate, **columns}
    folder = tempfile.TemporaryDirectory(prefix="whirl-")
    # Its name stands in rig files and reports that are made of it.
    path = Path(folder.name) / "in-memory.npz"
    _written(columns, path)
    return Record(path, time=time, recover=recover, resample=resample, folder=folder)
