//! A record as one array of NumPy (`.npy`): a matrix with a row for each sample (or a column for
//! each, where it is wider than high), its columns c1, c2, …; see [`super::arrays`].

use std::io::{BufReader, Read};
use std::path::Path;

use super::Record;
use super::arrays::{self, Array};
use super::formats::{Format, ReadOptions, open, shown};
use super::npz::{Decode, header};
use super::rows::ROW_LIMIT;
use crate::error::{BadInput, Result};
use crate::rig::Rig;

pub(super) const FORMAT: Format = Format {
    id: "npy",
    about: "NumPy array with a column for the time and one a channel (.npy)",
    extensions: &["npy"],
    is: |head| head.starts_with(b"\x93NUMPY"),
    columns: |path, _| {
        let matrix = Matrix::read(path)?;
        Ok(arrays::listed(&matrix.names(), |name| matrix.column(name)))
    },
    read,
    stream: None,
};

/// Most columns.
const MOST_COLUMNS: usize = 10_000;

/// All of the array.
struct Matrix {
    values: Array,
    rows: usize,
    columns: usize,
    /// Places between the values of a column.
    stride: usize,
}

fn read(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let matrix = Matrix::read(path)?;
    arrays::record(path, rig, &matrix.names(), options, |name| matrix.column(name))
}

impl Matrix {
    fn read(path: &Path) -> Result<Self> {
        let bad = |found: String, expected: &str, remedy: &str| {
            BadInput::new(found, expected).in_file(path).at("header").remedy(remedy)
        };
        let damaged = |e: std::io::Error| {
            bad(
                format!("a truncated or damaged array ({e})"),
                "a whole .npy",
                "Copy the file again, or save it again with numpy.save",
            )
        };
        let mut file = BufReader::new(open(path)?);
        let (kind, shape, by_columns) = header(&mut file).map_err(damaged)?;
        let numbers = "Save a matrix of numbers, np.save(file, np.column_stack([t, x])), or each column by its name with np.savez";
        let decode = Decode::of(&kind).ok_or_else(|| {
            bad(format!("values of type {}", shown(kind.as_bytes())), "numbers: float32, float64 or integers", numbers)
        })?;
        let sizes: Vec<usize> = shape.iter().map(|n| usize::try_from(*n).unwrap_or(usize::MAX)).collect();
        let [high, wide] = sizes[..] else {
            let shown: Vec<String> = shape.iter().map(u64::to_string).collect();
            return Err(bad(
                format!("{} values", shown.join(" × ")),
                "a matrix, a column for the time among others",
                numbers,
            ));
        };
        let count = high.checked_mul(wide).filter(|n| *n <= ROW_LIMIT && high.min(wide) <= MOST_COLUMNS);
        let count = count.ok_or_else(|| {
            bad(format!("{high} × {wide} values"), "a record that fits into memory", "Split the record")
        })?;
        let values = decode.read(&mut file, count).map_err(damaged)?;
        let rest = file.by_ref().take(1).read(&mut [0]).map_err(damaged)?;
        if rest > 0 {
            return Err(damaged(std::io::Error::new(
                std::io::ErrorKind::InvalidData,
                "more bytes than its header says",
            )));
        }
        // Samples are the longer side, whichever it is; values of a column then follow each other
        // or stand a row apart.
        let upright = high >= wide;
        let (rows, columns) = if upright { (high, wide) } else { (wide, high) };
        Ok(Self { values, rows, columns, stride: if upright == by_columns { 1 } else { columns } })
    }

    fn names(&self) -> Vec<String> {
        (1..=self.columns).map(|i| format!("c{i}")).collect()
    }

    fn column(&self, name: &str) -> Result<Array> {
        let k = name.strip_prefix('c').and_then(|k| k.parse::<usize>().ok()).filter(|k| (1..=self.columns).contains(k));
        let k = k.ok_or_else(|| BadInput::new(format!("\"{name}\""), format!("c1 to c{}", self.columns)))? - 1;
        let place = |i: usize| if self.stride == 1 { k * self.rows + i } else { i * self.stride + k };
        Ok(match &self.values {
            Array::Integers(x) => Array::Integers((0..self.rows).map(|i| x[place(i)]).collect()),
            Array::Floats(x) => Array::Floats((0..self.rows).map(|i| x[place(i)]).collect()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(kind: &str, shape: &str, by_columns: bool, data: &[u8]) -> (tempfile::TempDir, std::path::PathBuf) {
        let order = if by_columns { "True" } else { "False" };
        let mut header = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}");
        while !(10 + header.len() + 1).is_multiple_of(64) {
            header.push(' ');
        }
        header.push('\n');
        let mut out = b"\x93NUMPY\x01\x00".to_vec();
        out.extend((header.len() as u16).to_le_bytes());
        out.extend(header.as_bytes());
        out.extend(data);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.npy");
        std::fs::write(&path, out).unwrap();
        (folder, path)
    }

    fn rig(more: &str) -> Rig {
        let text = format!(
            "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n{more}[[channel]]\nname = \"c2\"\nmeasures = \"q\"\nunit = \"m\"\n"
        );
        Rig::parse(&text, Path::new("rig.toml")).unwrap()
    }

    #[test]
    fn a_matrix_is_read_whichever_way_it_lies() {
        let t = |i: usize| i as f64 * 0.01;
        let x = |i: usize| (0.1 * i as f64).sin();
        let by_rows: Vec<u8> = (0..300).flat_map(|i| [t(i), x(i)]).flat_map(f64::to_le_bytes).collect();
        let by_columns: Vec<u8> = (0..300).map(t).chain((0..300).map(x)).flat_map(f64::to_le_bytes).collect();
        for (shape, fortran, data) in [
            ("(300, 2)", false, &by_rows),
            ("(300, 2)", true, &by_columns),
            ("(2, 300)", false, &by_columns),
            ("(2, 300)", true, &by_rows),
        ] {
            let (_folder, path) = file("<f8", shape, fortran, data);
            let r = Record::read(&path, &rig("time = \"c1\"\n"), &ReadOptions::default()).unwrap();
            let want = crate::record::Column::Values((0..300).map(x).collect());
            assert_eq!((r.samples(), &r.segments[0].columns[0]), (300, &want), "{shape} {fortran}");
        }
    }

    #[test]
    fn what_is_no_matrix_of_numbers_is_told() {
        let told = |kind: &str, shape: &str, bytes: usize, more: &str| {
            let (_folder, path) = file(kind, shape, false, &vec![0; bytes]);
            Record::read(&path, &rig(more), &ReadOptions::default()).unwrap_err().to_string()
        };
        let time = "time = \"c1\"\n";
        assert!(told("<f8", "(300,)", 2400, time).contains("found 300 values, expected a matrix"));
        assert!(told("<U8", "(300, 2)", 9600, time).contains("values of type"));
        assert!(told("<f8", "(300, 2)", 4000, time).contains("truncated or damaged"));
        assert!(told("<f8", "(300, 2)", 4900, time).contains("more bytes"));
        assert!(told("<f8", "(300, 2)", 4800, "").contains("--time c1"));
        assert!(told("<f8", "(300, 1)", 2400, time).contains("a column c2"));
        assert!(told("<f8", "(99999999999, 99999999999)", 0, time).contains("fits into memory"));
    }
}
