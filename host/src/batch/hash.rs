//! SHA-256, as `sha256sum` prints it.

use std::fmt::Write;
use std::io::Read;
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::error::{BadInput, Result};
use crate::files;

fn hex(digest: &[u8]) -> String {
    digest.iter().fold(String::new(), |mut out, byte| {
        // Writing into a string cannot fail.
        let _ = write!(out, "{byte:02x}");
        out
    })
}

/// Of some bytes.
pub fn of(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Of a file, read a piece at a time.
///
/// # Errors
/// A file that cannot be read.
pub fn of_file(path: &Path) -> Result<String> {
    let mut file = files::open(path, "a file", "Name a file that exists and can be read")?;
    let (mut digest, mut piece) = (Sha256::new(), vec![0_u8; 1 << 16]);
    loop {
        match file.read(&mut piece) {
            Ok(0) => return Ok(hex(&digest.finalize())),
            Ok(n) => digest.update(&piece[..n]),
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(BadInput::io(path, &e).remedy("Copy the file again")),
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_file_has_the_hash_of_its_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc");
        std::fs::write(&path, "abc").unwrap();
        // FIPS 180-2, appendix B.1.
        let wanted = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!((super::of(b"abc").as_str(), super::of_file(&path).unwrap().as_str()), (wanted, wanted));
        assert!(super::of_file(&folder.path().join("none")).is_err());
    }
}
