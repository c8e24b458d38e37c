//! Markers inside whirl's Parquet records, by which a file without footer is read up to its last
//! whole row group.
//!
//! Parquet keeps all of its structure in a footer, so that a file cut short is lost as a whole.
//! Readers skip bytes that no footer points to; into such bytes, after the file's magic and after
//! each row group, goes a marker:
//!
//! | bytes | what |
//! |---|---|
//! | 16 | [`MAGIC`] |
//! | 4 | n, length of the body, little endian |
//! | 4 | CRC-32 of the row group's bytes (of nothing for the first marker) |
//! | n | a Parquet footer (thrift, as the format defines it) of that one row group alone; the first has none, but the key-value metadata |
//! | 4 | CRC-32 of the n + 8 bytes before |
//!
//! The row group's checksum is verified whenever a record of whirl's own is read, footer or not.

use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;

use flate2::Crc;
use parquet::errors::Result as ParquetResult;
use parquet::file::metadata::{
    FileMetaData, KeyValue, ParquetMetaData, ParquetMetaDataReader, ParquetMetaDataWriter, RowGroupMetaData,
};
use parquet::schema::types::SchemaDescriptor;

/// Starts a marker.
pub(super) const MAGIC: [u8; 16] = *b"\0whirl-marker\xd5\x1a\n";
/// Longest body that is believed, bytes.
const BODY_LIMIT: usize = 1 << 22;

/// CRC-32 (IEEE) of some bytes.
pub(super) fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// The marker for a row group (or, without one, for the start of the file).
pub(super) fn marker(
    schema: &Arc<SchemaDescriptor>,
    key_values: Option<Vec<KeyValue>>,
    group: Option<RowGroupMetaData>,
    data_crc: u32,
) -> ParquetResult<Vec<u8>> {
    let rows = group.as_ref().map_or(0, RowGroupMetaData::num_rows);
    let file = FileMetaData::new(1, rows, None, key_values, schema.clone(), None);
    let metadata = ParquetMetaData::new(file, group.into_iter().collect());
    let mut body = Vec::new();
    ParquetMetaDataWriter::new(&mut body, &metadata).finish()?;
    let mut out = MAGIC.to_vec();
    // A footer of one row group is a few kilobytes; the rig file's text is below BODY_LIMIT, see
    // ParquetWriter::create.
    out.extend_from_slice(&u32::try_from(body.len()).unwrap_or(u32::MAX).to_le_bytes());
    out.extend_from_slice(&data_crc.to_le_bytes());
    out.extend_from_slice(&body);
    let crc = crc32(&out[MAGIC.len()..]);
    out.extend_from_slice(&crc.to_le_bytes());
    Ok(out)
}

/// A marker that was read back.
pub(super) struct Marker {
    /// Where its magic stands.
    pub(super) offset: u64,
    /// The byte behind it.
    pub(super) end: u64,
    /// CRC-32 of the row group before it.
    pub(super) data_crc: u32,
    /// The footer within.
    pub(super) metadata: ParquetMetaData,
}

/// Reads the marker at `offset`; none where there is no whole one.
pub(super) fn marker_at<F: Read + Seek>(file: &mut F, offset: u64) -> Option<Marker> {
    let mut head = [0u8; MAGIC.len() + 8];
    file.seek(SeekFrom::Start(offset)).ok()?;
    file.read_exact(&mut head).ok()?;
    let (magic, numbers) = head.split_at(MAGIC.len());
    if magic != MAGIC {
        return None;
    }
    let n = u32::from_le_bytes(numbers[..4].try_into().ok()?) as usize;
    let data_crc = u32::from_le_bytes(numbers[4..].try_into().ok()?);
    if n > BODY_LIMIT {
        return None;
    }
    let mut rest = vec![0u8; n + 4];
    file.read_exact(&mut rest).ok()?;
    let (body, stored) = rest.split_at(n);
    let mut crc = Crc::new();
    crc.update(numbers);
    crc.update(body);
    if crc.sum().to_le_bytes() != stored {
        return None;
    }
    // The body ends with its own length and "PAR1".
    let footer = body.get(..n.checked_sub(8)?)?;
    let metadata = ParquetMetaDataReader::decode_metadata(footer).ok()?;
    let end = offset + (head.len() + rest.len()) as u64;
    Some(Marker { offset, end, data_crc, metadata })
}

/// The row group's checksum that a marker at `offset` states, whole or not.
pub(super) fn stated_crc<F: Read + Seek>(file: &mut F, offset: u64) -> Option<u32> {
    let mut crc = [0u8; 4];
    file.seek(SeekFrom::Start(offset.checked_add(MAGIC.len() as u64 + 4)?)).ok()?;
    file.read_exact(&mut crc).ok()?;
    Some(u32::from_le_bytes(crc))
}

/// Every whole marker of a file, found by its magic. Memory: one window and the markers.
pub(super) fn scan<F: Read + Seek>(file: &mut F) -> std::io::Result<Vec<Marker>> {
    let mut markers = Vec::new();
    let mut window: Vec<u8> = Vec::new();
    let mut base = 0u64;
    loop {
        file.seek(SeekFrom::Start(base + window.len() as u64))?;
        let got = file.by_ref().take(1 << 20).read_to_end(&mut window)?;
        let mut from = 0;
        while let Some(i) = find(&window[from..]) {
            let offset = base + (from + i) as u64;
            if let Some(marker) = marker_at(file, offset) {
                markers.push(marker);
            }
            from += i + 1;
        }
        if got == 0 {
            return Ok(markers);
        }
        // Keep as much as could begin a magic that the next window ends.
        let keep = window.len().min(MAGIC.len() - 1);
        base += (window.len() - keep) as u64;
        window.drain(..window.len() - keep);
    }
}

fn find(window: &[u8]) -> Option<usize> {
    window.windows(MAGIC.len()).position(|w| w == MAGIC)
}

/// CRC-32 of `length` bytes from `offset`; none where they are not all there.
pub(super) fn crc_of_range<F: Read + Seek>(file: &mut F, offset: u64, length: u64) -> Option<u32> {
    file.seek(SeekFrom::Start(offset)).ok()?;
    let mut crc = Crc::new();
    let mut left = length;
    let mut buffer = vec![0u8; length.min(1 << 16) as usize];
    while left > 0 {
        let n = left.min(buffer.len() as u64) as usize;
        file.read_exact(&mut buffer[..n]).ok()?;
        crc.update(&buffer[..n]);
        left -= n as u64;
    }
    Some(crc.sum())
}

/// First byte and length of a row group's column chunks; none where the metadata makes no sense.
pub(super) fn extent(group: &RowGroupMetaData) -> Option<(u64, u64)> {
    let (mut start, mut end) = (u64::MAX, 0);
    for column in group.columns() {
        let (first, length) = checked_range(column)?;
        start = start.min(first);
        end = end.max(first.checked_add(length)?);
    }
    (end > start).then(|| (start, end - start))
}

/// A column chunk's first byte and length, without the assertions of the library's own
/// `byte_range`.
pub(super) fn checked_range(column: &parquet::file::metadata::ColumnChunkMetaData) -> Option<(u64, u64)> {
    let first = column.dictionary_page_offset().unwrap_or_else(|| column.data_page_offset());
    Some((u64::try_from(first).ok()?, u64::try_from(column.compressed_size()).ok()?))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn the_checksum_of_a_range_is_that_of_its_bytes_however_many_there_are() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        let bytes: Vec<u8> = (0..200_000_u32).map(|i| (i.wrapping_mul(i) >> 7) as u8).collect();
        let mut file = Cursor::new(&bytes);
        for (from, n) in [(0, 200_000), (7, 65_536), (65_530, 65_537), (199_999, 1), (12, 0)] {
            let found = crc_of_range(&mut file, from as u64, n as u64);
            assert_eq!(found, Some(crc32(&bytes[from..from + n])), "{n} bytes from byte {from}");
        }
        assert_eq!(crc_of_range(&mut file, 100_000, 100_001), None);
    }
}
