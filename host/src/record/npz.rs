//! Records as NumPy archives (`.npz`), read with the npyz crate: see [`super::arrays`] for the arrays that are expected.
//!
//! Sizes are checked before anything is read, and the crate runs under `catch_unwind`.

use std::fs::File;
use std::io::{BufReader, Read};
use std::panic::AssertUnwindSafe;
use std::path::Path;

use npyz::npz::NpzArchive;
use npyz::{DType, NpyFile, TypeChar};

use super::arrays::{self, Array, Shape};
use super::formats::{Format, ReadOptions};
use super::{Record, quiet};
use crate::error::{BadInput, Result};
use crate::rig::Rig;

pub(super) const FORMAT: Format = Format {
    id: "npz",
    about: "NumPy archive with arrays t and one a channel (.npz)",
    extensions: &["npz"],
    is: |head| head.starts_with(b"PK\x03\x04") || head.starts_with(b"PK\x05\x06"),
    read,
};

/// Longest header of an array, bytes.
const HEADER_LIMIT: u32 = 1 << 16;

fn damaged(path: &Path, place: &str, what: impl std::fmt::Display) -> BadInput {
    BadInput::new(format!("a truncated or damaged archive ({what})"), "a whole .npz")
        .in_file(path)
        .at(place.to_owned())
        .remedy("Copy the file again, or save it again with numpy.savez")
}

fn read(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    quiet::catch(AssertUnwindSafe(|| read_archive(path, rig, options)))
        .unwrap_or_else(|| Err(damaged(path, "archive", "its reader gave up")))
}

fn read_archive(path: &Path, rig: &Rig, options: &ReadOptions) -> Result<Record> {
    let file = File::open(path).map_err(|e| BadInput::io(path, &e).remedy("Name a record that exists"))?;
    let mut archive = NpzArchive::new(BufReader::new(file)).map_err(|e| damaged(path, "end of file", e))?;
    let mut names: Vec<String> = archive.array_names().map(str::to_owned).collect();
    names.sort();
    arrays::record(path, rig, &names, options, |name| array(&mut archive, path, name))
}

fn array(archive: &mut NpzArchive<BufReader<File>>, path: &Path, name: &str) -> Result<Array> {
    let place = format!("array {name}");
    let bad = |e: std::io::Error| damaged(path, &place, e);
    // The length of the header decides how much its reader allocates.
    {
        let mut head = [0; 12];
        let mut entry = archive.zip_archive().by_name(&format!("{name}.npy")).map_err(|e| damaged(path, &place, e))?;
        entry.read_exact(&mut head).map_err(bad)?;
        let size = if head[6] == 1 {
            u32::from(u16::from_le_bytes([head[8], head[9]]))
        } else {
            u32::from_le_bytes([head[8], head[9], head[10], head[11]])
        };
        if !head.starts_with(b"\x93NUMPY") || size > HEADER_LIMIT {
            return Err(damaged(path, &place, "not an array of NumPy"));
        }
    }
    let file = archive.by_name(name).map_err(bad)?.ok_or_else(|| damaged(path, &place, "missing"))?;
    let count = Shape(file.shape().to_vec()).checked(path, name)?;
    let DType::Plain(kind) = file.dtype() else { return Err(kind_of(path, &place, &file.dtype().descr())) };
    macro_rules! floats {
        ($t:ty) => {
            Array::Floats(take::<$t, _>(file, count).map_err(bad)?.into_iter().map(f64::from).collect())
        };
    }
    macro_rules! integers {
        ($t:ty) => {
            Array::Integers(take::<$t, _>(file, count).map_err(bad)?.into_iter().map(i64::from).collect())
        };
    }
    Ok(match (kind.type_char(), kind.size_field()) {
        (TypeChar::Float, 8) => floats!(f64),
        (TypeChar::Float, 4) => floats!(f32),
        (TypeChar::Int, 8) => integers!(i64),
        (TypeChar::Int, 4) => integers!(i32),
        (TypeChar::Int, 2) => integers!(i16),
        (TypeChar::Int, 1) => integers!(i8),
        (TypeChar::Uint, 4) => integers!(u32),
        (TypeChar::Uint, 2) => integers!(u16),
        (TypeChar::Uint, 1) => integers!(u8),
        (TypeChar::Uint, 8) => {
            let all = take::<u64, _>(file, count).map_err(bad)?;
            Array::Integers(all.into_iter().map(|x| i64::try_from(x).unwrap_or(i64::MAX)).collect())
        }
        _ => return Err(kind_of(path, &place, &kind.to_string())),
    })
}

fn kind_of(path: &Path, place: &str, found: &str) -> BadInput {
    BadInput::new(format!("values of type {found}"), "numbers: float32, float64 or integers")
        .in_file(path)
        .at(place.to_owned())
        .remedy("Convert the array with .astype(float) before it is saved")
}

/// Reads `count` values; room grows with what the file really holds.
fn take<T: npyz::Deserialize, R: Read>(file: NpyFile<R>, count: usize) -> std::io::Result<Vec<T>> {
    let invalid = |e: npyz::DTypeError| std::io::Error::new(std::io::ErrorKind::InvalidData, e.to_string());
    let mut out = Vec::new();
    for x in file.data::<T>().map_err(invalid)?.take(count) {
        out.push(x?);
    }
    if out.len() < count {
        return Err(std::io::Error::new(std::io::ErrorKind::UnexpectedEof, format!("{} of {count} values", out.len())));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;
    use npyz::WriterBuilder;

    pub(super) fn rig() -> Rig {
        let text = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"q\"\nmeasures = \"q\"\nunit = \"mm\"\n\
                    [[channel]]\nname = \"c\"\nmeasures = \"a\"\nunit = \"count\"\ncounts_per_turn = 4096\n";
        Rig::parse(text, Path::new("rig.toml")).unwrap()
    }

    fn write(path: &Path, t: Option<&[f64]>, q: &[f32], c: &[i64], fs: Option<f64>) {
        let mut npz = npyz::npz::NpzWriter::create(path).unwrap();
        let mut put = |name: &str, x: &[f64]| {
            let mut w = npz
                .array(name, Default::default())
                .unwrap()
                .default_dtype()
                .shape(&[x.len() as u64])
                .begin_nd()
                .unwrap();
            w.extend(x.iter().copied()).unwrap();
            w.finish().unwrap();
        };
        if let Some(t) = t {
            put("t", t);
        }
        if let Some(fs) = fs {
            put("fs", &[fs]);
        }
        let mut w =
            npz.array("q", Default::default()).unwrap().default_dtype().shape(&[q.len() as u64, 1]).begin_nd().unwrap();
        w.extend(q.iter().copied()).unwrap();
        w.finish().unwrap();
        let mut w =
            npz.array("c", Default::default()).unwrap().default_dtype().shape(&[c.len() as u64]).begin_nd().unwrap();
        w.extend(c.iter().copied()).unwrap();
        w.finish().unwrap();
    }

    #[test]
    fn archives_are_read_and_bad_ones_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.npz");
        let rig = rig();
        let t: Vec<f64> = (0..500).map(|i| 3.0 + f64::from(i) * 0.01).collect();
        let mut q: Vec<f32> = (0..500_i16).map(|i| f32::from(i) * 0.5).collect();
        let c: Vec<i64> = (0..500).map(|i| i * 7).collect();
        q[100] = f32::NAN;
        write(&path, Some(&t), &q, &c, None);
        let read = |p: &Path| Record::read(p, &rig, &ReadOptions::default());
        let r = read(&path).unwrap();
        assert_eq!((r.samples(), r.segments.len(), r.losses.nan_rows), (499, 2, 1));
        assert!((r.segments[0].columns[0].angle(&rig.channel[0])[4] - 0.002).abs() < 1e-12, "mm to m");
        // No t, but a sampling rate.
        write(&path, None, &q, &c, Some(100.0));
        assert!(read(&path).unwrap().warnings.iter().any(|w| w.kind == "no-time"));
        let told = |parts: &[&str]| {
            let message = read(&path).unwrap_err().to_string();
            assert!(parts.iter().all(|p| message.contains(p)), "{message}");
        };
        write(&path, None, &q, &c, None);
        told(&["r.npz", "a column t", "fs (Hz)"]);
        write(&path, Some(&t[..40]), &q, &c, None);
        told(&["array t", "40 values in t, 500 in q"]);
        write(&path, Some(&t), &q, &c[..7], None);
        told(&["array c", "7 values in c"]);
        write(&path, Some(&t), &q, &c, None);
        let whole = std::fs::read(&path).unwrap();
        for cut in [30, 200, whole.len() / 2, whole.len() - 3] {
            std::fs::write(&path, &whole[..cut]).unwrap();
            told(&["r.npz", "truncated or damaged", "Copy"]);
        }
        // Every byte of headers flipped in turn: no panic, and never another answer than the values or an error.
        for k in (0..whole.len()).step_by(whole.len() / 300) {
            let mut bytes = whole.clone();
            bytes[k] ^= 0x41;
            std::fs::File::create(&path).unwrap().write_all(&bytes).unwrap();
            let _ = read(&path);
        }
    }
}
