use std::io::Write as _;

use flate2::Compression;
use flate2::write::DeflateEncoder;

use super::*;

fn rig() -> Rig {
    let text = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"q\"\nmeasures = \"q\"\nunit = \"mm\"\n\
                [[channel]]\nname = \"c\"\nmeasures = \"a\"\nunit = \"count\"\ncounts_per_turn = 4096\n";
    Rig::parse(text, Path::new("rig.toml")).unwrap()
}

fn npy(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(data);
    out
}

/// An archive as numpy.savez (stored) or savez_compressed writes it.
fn archive(deflated: bool, arrays: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let (mut out, mut directory) = (Vec::new(), Vec::new());
    for (name, data) in arrays {
        let mut crc = Crc::new();
        crc.update(data);
        let body = if deflated {
            let mut e = DeflateEncoder::new(Vec::new(), Compression::default());
            e.write_all(data).unwrap();
            e.finish().unwrap()
        } else {
            data.clone()
        };
        let name = format!("{name}.npy");
        let offset = out.len() as u32;
        let method: u16 = if deflated { 8 } else { 0 };
        let common = |into: &mut Vec<u8>| {
            into.extend([20, 0, 0, 0]);
            into.extend(method.to_le_bytes());
            into.extend([0; 4]);
            into.extend(crc.sum().to_le_bytes());
            into.extend((body.len() as u32).to_le_bytes());
            into.extend((data.len() as u32).to_le_bytes());
            into.extend((name.len() as u16).to_le_bytes());
            into.extend([0; 2]);
        };
        out.extend(b"PK\x03\x04");
        common(&mut out);
        out.extend(name.as_bytes());
        out.extend(&body);
        directory.extend(b"PK\x01\x02\x14\x00");
        common(&mut directory);
        directory.extend([0; 10]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let start = out.len() as u32;
    out.extend(&directory);
    out.extend(b"PK\x05\x06\x00\x00\x00\x00");
    out.extend([(arrays.len() as u16).to_le_bytes(), (arrays.len() as u16).to_le_bytes()].concat());
    out.extend((directory.len() as u32).to_le_bytes());
    out.extend(start.to_le_bytes());
    out.extend([0; 2]);
    out
}

fn doubles(x: impl Iterator<Item = f64>) -> Vec<u8> {
    x.flat_map(f64::to_le_bytes).collect()
}

fn good(deflated: bool, t: usize, c: i32, fs: Option<f64>) -> Vec<u8> {
    let q = (0..500_u16)
        .flat_map(|i| (if i == 100 { f32::NAN } else { f32::from(i) * 0.5 }).to_be_bytes())
        .collect::<Vec<u8>>();
    let mut arrays = vec![
        ("q", npy(">f4", "(500, 1)", &q)),
        ("c", npy("<i4", &format!("({c},)"), &(0..c).flat_map(|i| (-7 * i).to_le_bytes()).collect::<Vec<u8>>())),
        ("text", npy("<U3", "(1,)", &[0; 12])),
    ];
    if t > 0 {
        arrays.push(("t", npy("<f8", &format!("({t},)"), &doubles((0..t).map(|i| 3.0 + i as f64 * 0.01)))));
    }
    if let Some(fs) = fs {
        arrays.push(("fs", npy("<f8", "()", &doubles([fs].into_iter()))));
    }
    archive(deflated, &arrays)
}

fn read_bytes(bytes: &[u8], rig: &Rig) -> Result<Record> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.npz");
    std::fs::write(&path, bytes).unwrap();
    Record::read(&path, rig, &ReadOptions::default())
}

#[test]
fn stored_and_deflated_archives_are_read() {
    let rig = rig();
    for deflated in [false, true] {
        let r = read_bytes(&good(deflated, 500, 500, None), &rig).unwrap();
        assert_eq!((r.samples(), r.losses.received, r.segments.len(), r.losses.nan_rows), (500, 499, 1, 1));
        assert!((r.segments[0].columns[0].angle(&rig.channel[0])[4] - 0.002).abs() < 1e-12, "mm to m");
        assert_eq!(r.segments[0].columns[1], super::super::Column::Counts((0..500).map(|i| -7 * i).collect()));
        // No t, but a sampling rate.
        let r = read_bytes(&good(deflated, 0, 500, Some(100.0)), &rig).unwrap();
        assert!(r.warnings.iter().any(|w| w.id == "no-time"));
    }
}

#[test]
fn bad_archives_are_told() {
    let rig = rig();
    let told = |bytes: &[u8], parts: &[&str]| {
        let message = read_bytes(bytes, &rig).unwrap_err().to_string();
        assert!(parts.iter().all(|p| message.contains(p)), "{parts:?}: {message}");
    };
    told(&good(true, 0, 500, None), &["r.npz", "a column t", "fs (Hz)"]);
    told(&good(true, 40, 500, None), &["array t", "40 values in t, 500 in the channels"]);
    told(&good(true, 500, 7, None), &["array c", "7 values in c"]);
    told(&good(true, 0, 500, Some(-1.0)), &["array fs", "found -1", "above 0"]);
    let loud = archive(false, &[("q", npy("<\u{1b}8", "(5,)", &[0; 40])), ("c", npy("<i4", "(5,)", &[0; 20]))]);
    told(&loud, &["array q", "\\u{1b}"]);
    let whole = good(true, 500, 500, None);
    for cut in [30, 200, whole.len() / 2, whole.len() - 3] {
        told(&whole[..cut], &["r.npz", "truncated or damaged", "Copy"]);
    }
    // Bytes flipped in turn: no panic, and a changed array is never taken for a whole one.
    let truth = read_bytes(&whole, &rig).unwrap();
    for k in (0..whole.len()).step_by(whole.len() / 400) {
        let mut bytes = whole.clone();
        bytes[k] ^= 0x41;
        if let Ok(r) = read_bytes(&bytes, &rig) {
            assert_eq!(r.samples(), truth.samples(), "byte {k}");
        }
    }
    let text = Rig::parse(
        "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"text\"\nmeasures = \"q\"\nunit = \"mm\"\n",
        Path::new("rig.toml"),
    )
    .unwrap();
    let message = read_bytes(&whole, &text).unwrap_err().to_string();
    assert!(message.contains("array text") && message.contains("<U3") && message.contains("astype"), "{message}");
}

/// An archive of 32 bits as one of 64: the numbers that `wide` says (size, compressed size, offset)
/// stand in an extra field behind another one, all of the directory's own in its 64-bit end.
fn of_64_bits(archive: &[u8], wide: [bool; 3]) -> Vec<u8> {
    let end = archive.len() - 22;
    let (count, size, start) =
        (number(archive, end + 10, 2), number(archive, end + 12, 4) as usize, number(archive, end + 16, 4) as usize);
    let (mut out, mut at) = (archive[..start].to_vec(), start);
    while at < start + size {
        let name = number(archive, at + 28, 2) as usize;
        let mut head = archive[at..at + 46].to_vec();
        let mut extra = vec![0x55, 0x54, 5, 0, 1, 2, 3, 4, 5, 1, 0, 0, 0];
        for (place, _) in [24, 20, 42].into_iter().zip(wide).filter(|(_, wide)| *wide) {
            extra.extend(number(archive, at + place, 4).to_le_bytes());
            head[place..place + 4].fill(0xff);
            extra[11] += 8;
        }
        head[30..32].copy_from_slice(&(extra.len() as u16).to_le_bytes());
        out.extend([&head, &archive[at + 46..at + 46 + name], &extra].concat());
        at += 46 + name;
    }
    let (behind, size) = (out.len() as u64, (out.len() - start) as u64);
    out.extend(b"PK\x06\x06");
    out.extend([44_u64.to_le_bytes(), [45, 0, 45, 0, 0, 0, 0, 0]].concat());
    out.extend([[0; 4].to_vec(), [count, count, size, start as u64].map(u64::to_le_bytes).concat()].concat());
    out.extend([&b"PK\x06\x07\0\0\0\0"[..], &behind.to_le_bytes(), &[1, 0, 0, 0]].concat());
    out.extend([&b"PK\x05\x06\0\0\0\0"[..], &[0xff; 12], &[0, 0]].concat());
    out
}

#[test]
fn archives_of_64_bits_are_read() {
    let rig = rig();
    let plain = good(true, 500, 500, None);
    let truth = read_bytes(&plain, &rig).unwrap();
    for wide in [[true; 3], [false, false, true], [true, true, false], [false; 3]] {
        let r = read_bytes(&of_64_bits(&plain, wide), &rig).unwrap_or_else(|e| panic!("{wide:?}: {e}"));
        assert_eq!(
            (format!("{:?}", r.segments), r.losses),
            (format!("{:?}", truth.segments), truth.losses.clone()),
            "{wide:?}"
        );
    }
    // A locator that points elsewhere.
    let mut bytes = of_64_bits(&plain, [true; 3]);
    let locator = bytes.len() - 42;
    bytes[locator + 8] ^= 1;
    assert!(read_bytes(&bytes, &rig).unwrap_err().to_string().contains("no 64-bit end of the directory"));
}
