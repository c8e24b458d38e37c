//! Inputs spoilt on purpose: bits, bytes, chunks, lines and numbers, by a seeded generator.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Texts that take the place of a number.
pub const EXTREME: &[&str] = &[
    "1e308",
    "-1e308",
    "1e-188",
    "1e-320",
    "-0",
    "0",
    "-1",
    "NaN",
    "nan",
    "inf",
    "-inf",
    "2147483647",
    "2147483648",
    "-2147483649",
    "4294967296",
    "9223372036854775807",
    "9223372036854775808",
    "1000000000000000000000000000000",
    "0.1e-20",
    "1_000",
    "0x10",
    "--1",
    "1e",
    "",
    "\u{663}",
    "\"1\"",
    "[]",
    "{}",
    "true",
];

/// Numbers that take the place of four or eight bytes.
const WORDS: &[u64] = &[0, 1, 0x7fff_ffff, 0x8000_0000, u32::MAX as u64, 1 << 62, u64::MAX, 0x7ff0_0000_0000_0000];

/// Longest run that one mutation adds, bytes.
const LONG: usize = 1 << 16;

/// Bytes with one to three mutations, mostly one: it goes deeper than several, which are sooner
/// refused.
pub fn mutated(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..[1, 1, 1, 2, 3][rng.random_range(0..5)] {
        once(&mut out, rng);
    }
    out
}

/// A range of up to `most` bytes.
fn range(n: usize, most: usize, rng: &mut ChaCha8Rng) -> std::ops::Range<usize> {
    let from = rng.random_range(0..=n);
    from..(from + rng.random_range(0..=most)).min(n)
}

fn once(out: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    let n = out.len();
    if n == 0 {
        out.extend((0..rng.random_range(1..64)).map(|_| rng.random::<u8>()));
        return;
    }
    // Heads and tails say how the rest is to be read: a third of the damage goes there.
    let at = match rng.random_range(0..6) {
        0 => rng.random_range(0..n.min(200)),
        1 => n - 1 - rng.random_range(0..n.min(400)),
        _ => rng.random_range(0..n),
    };
    match rng.random_range(0..15) {
        0 | 1 => out[at] ^= 1 << rng.random_range(0..8),
        2 => out[at] = [0, 0xff, b'"', b'\n', rng.random()][rng.random_range(0..5)],
        3 => out.truncate(at),
        4 => {
            // A piece of it, somewhere else.
            let piece = out[range(n, 512, rng)].to_vec();
            out.splice(at..at, piece);
        }
        5 => {
            let piece = out[range(n, 512, rng)].to_vec();
            let to = (at + piece.len()).min(n);
            out.splice(at..to, piece);
        }
        6 => drop(out.drain(range(n, 2000, rng))),
        7 | 8 => lines(out, rng),
        9 | 10 => number(out, at, rng),
        11 => {
            let unit: Vec<u8> = if rng.random() { vec![out[at]] } else { out[range(n, 40, rng)].to_vec() };
            let times = rng.random_range(1..LONG) / unit.len().max(1);
            out.splice(at..at, unit.repeat(times));
        }
        12 => {
            let control = [&b"\x1b[2J"[..], b"\x07", b"\r", b"\0", b"\xe2\x80\xae", b"\xff\xfe", b"\x9b"];
            let text = control[rng.random_range(0..control.len())];
            out.splice(at..at, text.iter().copied());
        }
        13 => {
            let word = WORDS[rng.random_range(0..WORDS.len())].to_le_bytes();
            let size = if rng.random() { 4 } else { 8 };
            out.iter_mut().skip(at).zip(&word[..size]).for_each(|(to, from)| *to = *from);
        }
        _ => {
            let random: Vec<u8> = (0..rng.random_range(1..64)).map(|_| rng.random()).collect();
            out.splice(at..at, random);
        }
    }
}

/// Takes a line away, doubles it or exchanges it with another one.
fn lines(out: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    let mut list: Vec<Vec<u8>> = out.split_inclusive(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
    let (i, j) = (rng.random_range(0..list.len()), rng.random_range(0..list.len()));
    match rng.random_range(0..3) {
        0 => drop(list.remove(i)),
        1 => list.insert(j, list[i].clone()),
        _ => list.swap(i, j),
    }
    *out = list.concat();
}

/// Replaces the first number from `at` on by an extreme one.
fn number(out: &mut Vec<u8>, at: usize, rng: &mut ChaCha8Rng) {
    let part = |b: &u8| b.is_ascii_digit() || b".eE+-".contains(b);
    let Some(from) = out.iter().skip(at).position(u8::is_ascii_digit).map(|i| at + i) else { return };
    let to = from + out[from..].iter().take_while(|b| part(b)).count();
    let text = EXTREME[rng.random_range(0..EXTREME.len())];
    out.splice(from..to, text.bytes());
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn mutations_are_seeded_varied_and_bounded() {
        let bytes = b"t,count1\n0.0,1\n0.1,2\n0.2,3\n".repeat(20);
        let make = |seed| mutated(&bytes, &mut ChaCha8Rng::seed_from_u64(seed));
        let all: std::collections::BTreeSet<Vec<u8>> = (0..500).map(make).collect();
        assert!(all.len() > 450 && make(7) == make(7), "{}", all.len());
        assert!(all.iter().all(|b| b.len() <= bytes.len() + 3 * LONG));
        assert!(
            EXTREME
                .iter()
                .filter(|x| x.len() > 4)
                .all(|x| all.iter().any(|b| { String::from_utf8_lossy(b).contains(x) }))
        );
    }
}
