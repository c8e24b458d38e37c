use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::*;

fn rig() -> Rig {
    let text = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"q\"\nmeasures = \"q\"\nunit = \"mm\"\n\
                [[channel]]\nname = \"c\"\nmeasures = \"a\"\nunit = \"count\"\ncounts_per_turn = 4096\n";
    Rig::parse(text, Path::new("rig.toml")).unwrap()
}

/// An element with its padding; short ones packed into the tag as MATLAB does.
fn element(little: bool, kind: u32, data: &[u8]) -> Vec<u8> {
    let n = |x: u32| if little { x.to_le_bytes() } else { x.to_be_bytes() };
    let mut out = Vec::new();
    if (1..=4).contains(&data.len()) {
        out.extend(n(kind | (data.len() as u32) << 16));
        out.extend(data);
        out.resize(8, 0);
        return out;
    }
    out.extend(n(kind));
    out.extend(n(data.len() as u32));
    out.extend(data);
    out.resize(out.len().next_multiple_of(8), 0);
    out
}

fn array(little: bool, class: u8, dimensions: &[u32], name: &str, kind: u32, data: &[u8]) -> Vec<u8> {
    let n = |x: u32| if little { x.to_le_bytes() } else { x.to_be_bytes() };
    let flags = [n(class.into()), n(0)].concat();
    let sizes: Vec<u8> = dimensions.iter().flat_map(|d| n(*d)).collect();
    let body = [
        element(little, 6, &flags),
        element(little, 5, &sizes),
        element(little, 1, name.as_bytes()),
        element(little, kind, data),
    ]
    .concat();
    element(little, ARRAY, &body)
}

fn file(little: bool, compressed: bool, arrays: &[Vec<u8>]) -> Vec<u8> {
    let mut out = b"MATLAB 5.0 MAT-file, written by a test".to_vec();
    out.resize(124, b' ');
    out.extend(if little { [0, 1, b'I', b'M'] } else { [1, 0, b'M', b'I'] });
    for a in arrays {
        if compressed {
            let mut z = ZlibEncoder::new(Vec::new(), Compression::default());
            z.write_all(a).unwrap();
            let z = z.finish().unwrap();
            let n = |x: u32| if little { x.to_le_bytes() } else { x.to_be_bytes() };
            out.extend(n(COMPRESSED));
            out.extend(n(z.len() as u32));
            out.extend(z);
        } else {
            out.extend(a);
        }
    }
    out
}

fn doubles(little: bool, x: &[f64]) -> Vec<u8> {
    x.iter().flat_map(|x| if little { x.to_le_bytes() } else { x.to_be_bytes() }).collect()
}

fn good(little: bool, compressed: bool) -> Vec<u8> {
    let t: Vec<f64> = (0..300).map(|i| f64::from(i) * 0.01).collect();
    let mut q: Vec<f64> = (0..300).map(|i| f64::from(i) * 0.5).collect();
    q[7] = f64::NAN;
    // Whole numbers of class double are stored as 16-bit integers.
    let c: Vec<u8> =
        (0..300_i16).flat_map(|i| if little { (3 * i).to_le_bytes() } else { (3 * i).to_be_bytes() }).collect();
    file(
        little,
        compressed,
        &[
            array(little, 4, &[1, 5], "note", 16, b"hello"),
            array(little, 6, &[300, 1], "t", 9, &doubles(little, &t)),
            array(little, 6, &[1, 300], "q", 9, &doubles(little, &q)),
            array(little, 6, &[300, 1], "c", 3, &c),
            array(little, 6, &[3, 2], "matrix", 9, &doubles(little, &[0.0; 6])),
        ],
    )
}

fn read_bytes(bytes: &[u8], rig: &Rig) -> Result<Record> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.mat");
    std::fs::write(&path, bytes).unwrap();
    Record::read(&path, rig, &ReadOptions::default())
}

#[test]
fn both_byte_orders_plain_and_compressed() {
    let rig = rig();
    for little in [true, false] {
        for compressed in [true, false] {
            let r = read_bytes(&good(little, compressed), &rig).unwrap();
            assert_eq!((r.samples(), r.segments.len(), r.losses.nan_rows), (300, 1, 1), "{little} {compressed}");
            assert_eq!(r.segments[0].columns[1], super::super::Column::Counts((0..300).map(|i| 3 * i).collect()));
            assert!((r.segments[0].columns[0].angle(&rig.channel[0])[4] - 0.002).abs() < 1e-12);
        }
    }
}

/// A file that MATLAB's own layout rules give, as scipy writes it: see the hexadecimal of its first
/// variable.
#[test]
fn what_cannot_be_read_says_so() {
    let told = |bytes: &[u8], rig: &Rig, parts: &[&str]| {
        let message = read_bytes(bytes, rig).unwrap_err().to_string();
        assert!(parts.iter().all(|p| message.contains(p)), "{parts:?}: {message}");
    };
    let rig = rig();
    for compressed in [true, false] {
        let whole = good(true, compressed);
        for cut in [60, 130, 400, whole.len() / 2, whole.len() - 1] {
            let message = read_bytes(&whole[..cut], &rig).unwrap_err().to_string();
            assert!(message.contains("r.mat"), "{cut}: {message}");
        }
        told(&whole[..whole.len() / 2], &rig, &["truncated or damaged", "Copy the file again"]);
        for k in (128..whole.len()).step_by(whole.len() / 400) {
            let mut bytes = whole.clone();
            bytes[k] ^= 0x81;
            let _ = read_bytes(&bytes, &rig);
        }
    }
    let named = |name: &str| {
        let text = format!(
            "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"{name}\"\nmeasures = \"q\"\nunit = \"mm\"\n"
        );
        Rig::parse(&text, Path::new("rig.toml")).unwrap()
    };
    told(&good(true, true), &named("note"), &["variable note", "a text", "a vector of real numbers"]);
    told(&good(true, true), &named("matrix"), &["3 × 2", "a vector", "\"matrix(:,1)\""]);
    told(&good(true, true), &named("speed"), &["\"matrix\"", "a column speed"]);
}

/// A compressed element that would inflate to far more than it holds is not inflated.
#[test]
fn a_bomb_is_not_inflated() {
    let mut a = array(true, 6, &[4_000_000_000, 1], "q", 9, &[0; 64]);
    a.extend(vec![0; 50_000_000]);
    let bytes = file(true, true, &[array(true, 6, &[1, 1], "fs", 9, &doubles(true, &[100.0])), a]);
    assert!(bytes.len() < 200_000);
    let message = read_bytes(&bytes, &rig()).unwrap_err().to_string();
    assert!(message.contains("\"q\"") || message.contains("elements"), "{message}");
}
