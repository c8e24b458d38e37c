//! Lines of JSON objects that carry a checksum: `{…,"crc32":"89abcdef"}`, the CRC-32 (IEEE 802.3)
//! of the line's bytes before that key, in eight hexadecimal digits. Lines without it are from
//! before there was one.

use flate2::Crc;

const KEY: &str = ",\"crc32\":\"";

fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// Adds the checksum to an object's text.
pub(crate) fn seal(object: &str) -> String {
    let body = object.strip_suffix('}').unwrap_or(object);
    format!("{body}{KEY}{:08x}\"}}", crc32(body.as_bytes()))
}

/// A line as it was before it was sealed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Opened {
    /// It has no checksum.
    Bare,
    /// Its checksum is right: the object's text.
    Right(String),
    /// Its checksum is wrong.
    Wrong,
}

/// Takes the checksum off a line (without its line feed) and checks it.
pub(crate) fn open(line: &str) -> Opened {
    let Some((body, rest)) = line.rsplit_once(KEY) else { return Opened::Bare };
    let crc = rest.strip_suffix("\"}").filter(|hex| hex.len() == 8).and_then(|hex| u32::from_str_radix(hex, 16).ok());
    if crc == Some(crc32(body.as_bytes())) { Opened::Right(format!("{body}}}")) } else { Opened::Wrong }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flipped_bit_is_noticed() {
        let object = "{\"a\":1,\"b\":[0.5]}";
        let sealed = seal(object);
        assert_eq!(sealed, "{\"a\":1,\"b\":[0.5],\"crc32\":\"".to_owned() + &sealed[26..34] + "\"}");
        assert_eq!(open(&sealed), Opened::Right(object.to_owned()));
        assert_eq!(open(object), Opened::Bare);
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
        for i in 0..sealed.len() {
            for bit in 0..7 {
                let mut bytes = sealed.clone().into_bytes();
                bytes[i] ^= 1 << bit;
                let Ok(flipped) = String::from_utf8(bytes) else { continue };
                // A digit's case is not its value.
                let same = flipped.to_lowercase() == sealed;
                assert!(same || !matches!(open(&flipped), Opened::Right(_)), "{flipped}");
            }
        }
    }
}
