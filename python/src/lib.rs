//! The extension module behind the Python package `whirl`: words of a command line go in, what the
//! command says comes out ([`whirl::api`]). Names, types and tables are Python's, in `whirl/`.

use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread::Builder;
use std::time::Duration;

use pyo3::create_exception;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use whirl::api::{self, Called};
use whirl::error::BadInput;
use whirl::init::{Settings, columns_of};
use whirl::record::{Column, ReadOptions, Record, metadata};
use whirl::rig::choices::Choices;

create_exception!(
    whirl,
    Error,
    PyValueError,
    "Bad input or usage, in the program's words: file, place, what was found, what was expected, what to do."
);

/// Stack of a thread that works, bytes: as much as the program's first one has.
const STACK: usize = 8 << 20;
/// How often Python is asked whether somebody pressed Ctrl-C.
const PATIENCE: Duration = Duration::from_millis(50);

/// The error with its parts.
fn raised(py: Python<'_>, error: api::Error) -> PyErr {
    let raised = Error::new_err(error.to_string());
    if let api::Error::Input(input) = error {
        let BadInput { file, place, found, expected, remedy } = *input;
        let value = raised.value(py);
        let parts = [("place", place), ("found", Some(found)), ("expected", Some(expected)), ("remedy", Some(remedy))];
        let set = parts.into_iter().try_for_each(|(name, part)| value.setattr(name, part));
        if let Err(e) = set.and_then(|()| value.setattr("file", file)) {
            return e;
        }
    }
    raised
}

/// Works on a thread of its own, so that other threads of Python go on and Ctrl-C is heard; work
/// that is left then ends unheard.
fn waited<T: Send + 'static>(py: Python<'_>, work: impl FnOnce() -> api::Result<T> + Send + 'static) -> PyResult<T> {
    let (done, mut result) = channel();
    Builder::new().stack_size(STACK).spawn(move || done.send(work()).is_ok())?;
    loop {
        let (back, heard) = py.detach(move || {
            let heard = result.recv_timeout(PATIENCE);
            (result, heard)
        });
        match heard {
            Ok(outcome) => return outcome.map_err(|e| raised(py, e)),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("whirl gave up on this, which is a mistake of its own"));
            }
        }
        result = back;
    }
}

/// What a command said, and its answer to be written out.
#[pyclass(frozen)]
struct Answer {
    called: std::sync::Arc<Called>,
}

#[pymethods]
impl Answer {
    /// The result as JSON; none where the command has no such result.
    #[getter]
    fn json(&self) -> Option<&str> {
        self.called.said.json.as_deref()
    }

    /// The answer for people.
    #[getter]
    fn text(&self) -> &str {
        &self.called.said.text
    }

    /// The warnings: id, text, advice.
    #[getter]
    fn warnings(&self) -> Vec<(&'static str, &str, &str)> {
        self.called.said.warnings.iter().map(|w| (w.id, w.text.as_str(), w.advice.as_str())).collect()
    }

    /// What makes the answer negative, line by line.
    #[getter]
    fn reasons(&self) -> Vec<String> {
        self.called.said.remarks.clone()
    }

    /// Whether the exit status would be 0.
    #[getter]
    fn positive(&self) -> bool {
        self.called.positive
    }

    /// Writes what further options name.
    fn write(&self, py: Python<'_>, further: Vec<OsString>) -> PyResult<()> {
        let called = self.called.clone();
        waited(py, move || called.write(&further))
    }
}

/// Calls a command with the words that would stand behind `whirl`.
#[pyfunction]
fn call(py: Python<'_>, words: Vec<OsString>) -> PyResult<Answer> {
    waited(py, move || api::call(&words)).map(|called| Answer { called: called.into() })
}

/// The options of a command: name, help, whether it takes a value.
#[pyfunction]
fn options(command: &str) -> Vec<(String, String, bool)> {
    api::options(command).into_iter().map(|o| (o.name, o.help, o.takes_value)).collect()
}

/// Binary64 as Python's bytes.
fn bytes<'py>(py: Python<'py>, values: impl Iterator<Item = f64>) -> Bound<'py, PyBytes> {
    PyBytes::new(py, &values.flat_map(f64::to_ne_bytes).collect::<Vec<u8>>())
}

/// A record's columns of numbers as they stand.
#[pyclass(frozen)]
struct Columns {
    record: Record,
}

#[pymethods]
impl Columns {
    /// The sampling rate, Hz.
    #[getter]
    fn rate(&self) -> f64 {
        self.record.sample_rate_hz
    }

    /// First row of each unbroken stretch, and the number of rows behind the last.
    #[getter]
    fn bounds(&self) -> Vec<usize> {
        let ends = self.record.segments.iter().scan(0, |end, s| {
            *end += s.len();
            Some(*end)
        });
        std::iter::once(0).chain(ends).collect()
    }

    /// Time of each row, s, binary64.
    fn time<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        bytes(py, self.record.segments.iter().flat_map(|s| (0..s.len()).map(|i| s.time(i))))
    }

    /// Names of the columns.
    #[getter]
    fn names(&self) -> Vec<&str> {
        self.record.channels.iter().map(|c| c.name.as_str()).collect()
    }

    /// The values of a column by its number, binary64.
    fn values<'py>(&self, py: Python<'py>, column: usize) -> Bound<'py, PyBytes> {
        let columns = self.record.segments.iter().filter_map(|s| s.columns.get(column));
        bytes(
            py,
            columns.flat_map(|c| match c {
                Column::Values(v) => v.clone(),
                Column::Counts(c) => c.iter().map(|c| f64::from(*c)).collect(),
            }),
        )
    }

    /// What was noticed on reading: id, text, advice.
    #[getter]
    fn warnings(&self) -> Vec<(&'static str, &str, &str)> {
        self.record.warnings.iter().map(|w| (w.id, w.text.as_str(), w.advice.as_str())).collect()
    }
}

/// Reads a record's columns of numbers.
#[pyfunction]
fn columns(py: Python<'_>, path: PathBuf, time: Option<String>, recover: bool, resample: bool) -> PyResult<Columns> {
    let choices = Choices { time, map: Vec::new() };
    let settings = Settings { choices, options: ReadOptions { recover, resample }, ..Settings::default() };
    waited(py, move || Ok(columns_of(&path, &settings)?)).map(|record| Columns { record })
}

/// The metadata of one of whirl's own records, as JSON.
#[pyfunction]
fn metadata_of(path: PathBuf) -> Option<String> {
    metadata(&path).and_then(|m| serde_json::to_string(&m).ok())
}

#[pymodule]
fn _whirl(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("Error", module.py().get_type::<Error>())?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<Answer>()?;
    module.add_class::<Columns>()?;
    module.add_function(wrap_pyfunction!(call, module)?)?;
    module.add_function(wrap_pyfunction!(options, module)?)?;
    module.add_function(wrap_pyfunction!(columns, module)?)?;
    module.add_function(wrap_pyfunction!(metadata_of, module)?)
}
