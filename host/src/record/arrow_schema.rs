//! Columns of lengths of time in a Parquet file: Parquet has no type for them, so that pandas and
//! polars write whole numbers, and what they count in the schema of Apache Arrow that they put into
//! the file's metadata (`ARROW:schema`).
//!
//! That schema is a FlatBuffer (Arrow's `Schema.fbs` within `Message.fbs`) in base64; of it the
//! fields' names and types are read, every offset checked. What does not fit says nothing.
//!
//! *Why not a crate*: arrow-ipc brings all of Arrow's arrays for these two tables.

use std::collections::BTreeMap;

use parquet::file::metadata::ParquetMetaData;

/// Number of Arrow's type for a length of time.
const DURATION: u8 = 18;
/// Most fields that are looked at.
const MOST_FIELDS: usize = 1 << 16;

/// How many of a column's units there are in a second, for each column of lengths of time.
pub(super) fn durations(file: &ParquetMetaData) -> BTreeMap<String, f64> {
    let pairs = file.file_metadata().key_value_metadata();
    let text = pairs.and_then(|p| p.iter().find(|kv| kv.key == "ARROW:schema")?.value.clone());
    text.and_then(|text| of_message(&base64(&text)?)).unwrap_or_default()
}

/// Bytes of a text in base64; none where it is not one.
fn base64(text: &str) -> Option<Vec<u8>> {
    let (mut out, mut held, mut bits) = (Vec::with_capacity(text.len() / 4 * 3), 0_u32, 0);
    for b in text.bytes().filter(|b| *b != b'=' && !b.is_ascii_whitespace()) {
        let six = match b {
            b'A'..=b'Z' => b - b'A',
            b'a'..=b'z' => b - b'a' + 26,
            b'0'..=b'9' => b - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        held = held << 6 | u32::from(six);
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            out.push((held >> bits & 0xff) as u8);
        }
    }
    Some(out)
}

/// A table of a FlatBuffer: where it stands.
#[derive(Clone, Copy)]
struct Table<'a> {
    bytes: &'a [u8],
    at: usize,
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..at.checked_add(N)?)?.try_into().ok()
}

fn offset(bytes: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u32::from_le_bytes(number(bytes, at)?)).ok()?.checked_add(at)
}

impl<'a> Table<'a> {
    /// Where a field stands, within none where it has its default; none where the table is cut.
    fn place(self, index: usize) -> Option<Option<usize>> {
        let back = i32::from_le_bytes(number(self.bytes, self.at)?);
        let vtable = usize::try_from(i64::try_from(self.at).ok()? - i64::from(back)).ok()?;
        let size = usize::from(u16::from_le_bytes(number(self.bytes, vtable)?));
        let entry = 4 + 2 * index;
        if entry + 2 > size {
            return Some(None);
        }
        let from = usize::from(u16::from_le_bytes(number(self.bytes, vtable + entry)?));
        Some((from > 0).then_some(self.at + from))
    }

    /// Where a field stands that has no default.
    fn field(self, index: usize) -> Option<usize> {
        self.place(index)?
    }

    fn table(self, index: usize) -> Option<Self> {
        Some(Self { at: offset(self.bytes, self.field(index)?)?, ..self })
    }

    fn text(self, index: usize) -> Option<&'a str> {
        let at = offset(self.bytes, self.field(index)?)?;
        let length = usize::try_from(u32::from_le_bytes(number(self.bytes, at)?)).ok()?;
        core::str::from_utf8(self.bytes.get(at + 4..(at + 4).checked_add(length)?)?).ok()
    }

    /// The tables of a vector.
    fn tables(self, index: usize) -> Option<Vec<Self>> {
        let at = offset(self.bytes, self.field(index)?)?;
        let count = usize::try_from(u32::from_le_bytes(number(self.bytes, at)?)).ok()?;
        (0..count.min(MOST_FIELDS)).map(|i| Some(Self { at: offset(self.bytes, at + 4 + 4 * i)?, ..self })).collect()
    }
}

fn of_message(bytes: &[u8]) -> Option<BTreeMap<String, f64>> {
    // A mark that goes on before the length in newer files.
    let start = if number::<4>(bytes, 0)? == [0xff; 4] { 8 } else { 4 };
    let bytes = bytes.get(start..)?;
    let message = Table { bytes, at: offset(bytes, 0)? };
    let schema = message.table(2)?;
    let mut out = BTreeMap::new();
    for field in schema.tables(1)? {
        let kind = field.field(2).and_then(|at| bytes.get(at).copied());
        if let (Some(name), Some(DURATION)) = (field.text(0), kind) {
            let unit = match field.table(3).and_then(|t| t.place(0)) {
                Some(Some(at)) => number(bytes, at).map(i16::from_le_bytes),
                // Milliseconds are the default, which is not written.
                Some(None) => Some(1),
                None => None,
            };
            let per_second = match unit {
                Some(0) => 1.0,
                Some(1) => 1e3,
                Some(2) => 1e6,
                Some(3) => 1e9,
                _ => continue,
            };
            out.insert(name.to_owned(), per_second);
        }
    }
    Some(out)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// As polars 2.1 and pyarrow 26 (with which pandas writes) put it into a file.
    pub(in crate::record) const POLARS: &str = "/////6gAAAAEAAAA8v///xQAAAAEAAEAAAAKAAsACAAKAAQA+P///wwAAAAIAAgAAAAEAAIAAAA4AAAABAAAALz///8cAAAAEAAA\
        AAgAAAABAwAAAAAAALr///8CAAAACQAAAGFuZ2xlX2RlZwAAAOz///8wAAAAIAAAABgAAAABEgAAEAASAAQAEAARAAgAAAAMAAAA\
        AAD6////AgAGAAYABAAHAAAAZWxhcHNlZAA=";
    const PANDAS: &str = "/////7AAAAAQAAAAAAAKAAwABgAFAAgACgAAAAABBAAMAAAACAAIAAAABAAIAAAABAAAAAIAAABMAAAABAAAAMz///8AAAECEAAA\
        ABwAAAAEAAAAAAAAAAEAAABuAAAACAAMAAgABwAIAAAAAAAAAUAAAAAQABQACAAGAAcADAAAABAAEAAAAAAAARIQAAAAIAAAAAQA\
        AAAAAAAABwAAAGVsYXBzZWQAAAAGAAgABgAGAAAAAAADAA==";

    #[test]
    fn base64_is_read() {
        assert_eq!(base64("aGVsbG8=").unwrap(), b"hello");
        assert_eq!(base64("a*"), None);
    }

    #[test]
    fn damaged_schemas_say_nothing_else() {
        for text in [POLARS, PANDAS] {
            let whole = base64(text).unwrap();
            let told = of_message(&whole).unwrap();
            for i in 0..whole.len() {
                let mut changed = whole.clone();
                changed[i] ^= 0xff;
                for damaged in [&whole[..i], &changed[..]] {
                    let left = of_message(damaged).unwrap_or_default();
                    assert!(left.is_empty() || left == told, "{i}: {left:?}");
                }
            }
        }
    }

    #[test]
    fn lengths_of_time_are_found_with_their_unit() {
        let found = of_message(&base64(POLARS).unwrap()).unwrap();
        assert_eq!(found.into_iter().collect::<Vec<_>>(), [("elapsed".to_owned(), 1e6)]);
        let found = of_message(&base64(PANDAS).unwrap()).unwrap();
        assert_eq!(found.into_iter().collect::<Vec<_>>(), [("elapsed".to_owned(), 1e9)]);
    }
}
