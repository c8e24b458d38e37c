//! A quadrature encoder and the decoder behind it.
//!
//! An encoder of L lines shows two square waves A and B, a quarter of a line apart. With q =
//! ⌊θ·4L/2π⌋ (the number of edges since θ = 0) the pair (A, B) is 00, 10, 11, 01 for q mod 4 = 0,
//! 1, 2, 3. The decoder sees the pair alone and holds a 16-bit counter, as a timer in encoder mode
//! does:
//! * ×4 counts every edge: N = 4L, count = ⌊θ·4L/2π⌋ mod 2¹⁶;
//! * ×1 counts the edge of B while A is low: N = L, count = ⌊θ·L/2π⌋ mod 2¹⁶.
//!
//! A pair that differs in both lines at once cannot come from one edge: it is counted as illegal
//! and moves nothing. Angles in rad. There is no hysteresis and no bounce: an arm that trembles
//! about an edge counts up and down, and is right.

use core::f64::consts::TAU;

use whirl_firmware::QuadratureCounter;

/// Which edges are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decoding {
    /// One a line.
    X1,
    /// All four a line.
    X4,
}

/// Levels of A and B.
type Pair = (bool, bool);

fn pair(quarter: i64) -> Pair {
    match quarter.rem_euclid(4) {
        0 => (false, false),
        1 => (true, false),
        2 => (true, true),
        _ => (false, true),
    }
}

/// Index of an angle among N parts of a turn, ⌊θ·N/2π⌋. Beyond ±2⁶³ it saturates.
pub fn count_of(angle: f64, counts_per_turn: u32) -> i64 {
    libm::floor(angle * (f64::from(counts_per_turn) / TAU)) as i64
}

/// The disc: where it stands, in quarters of a line.
#[derive(Clone, Debug)]
pub struct Disc {
    lines: u32,
    quarter: i64,
}

impl Disc {
    /// A disc of `lines` lines at an angle.
    pub fn new(lines: u32, angle: f64) -> Self {
        Self { lines, quarter: Self::quarter_of(lines, angle) }
    }

    fn quarter_of(lines: u32, angle: f64) -> i64 {
        // Four times the quotient is exact, so that both decodings agree with `count_of` to the
        // last digit.
        libm::floor(angle * (f64::from(lines) / TAU) * 4.0) as i64
    }

    /// The present levels.
    pub fn levels(&self) -> (bool, bool) {
        pair(self.quarter)
    }

    /// Turns the disc to an angle, edge by edge. What lies between the present angle and the new
    /// one does not matter: every way there that returns makes edges that cancel.
    ///
    /// Whole rounds of a 16-bit counter (2¹⁸ edges), which it could not tell, are left out, so that
    /// no jump takes long.
    pub fn turn_to(&mut self, angle: f64, mut edge: impl FnMut(bool, bool)) {
        let target = Self::quarter_of(self.lines, angle);
        let distance = i128::from(target) - i128::from(self.quarter);
        let edges = (distance.unsigned_abs() % (4 << 16)) as u32;
        let direction: i64 = if distance < 0 { -1 } else { 1 };
        self.quarter = target.wrapping_sub(direction * i64::from(edges));
        for _ in 0..edges {
            self.quarter = self.quarter.wrapping_add(direction);
            let (a, b) = pair(self.quarter);
            edge(a, b);
        }
    }
}

/// A timer in encoder mode.
#[derive(Clone, Debug)]
pub struct QuadratureDecoder {
    decoding: Decoding,
    last: Pair,
    count: u16,
    illegal: u64,
}

/// Steps by (last A, last B, A, B): 0 none, 2 illegal.
const TRANSITIONS: [i8; 16] = [
    0, -1, 1, 2, // from 00 to 00, 01, 10, 11
    1, 0, 2, -1, // from 01
    -1, 2, 0, 1, // from 10
    2, 1, -1, 0, // from 11
];

impl QuadratureDecoder {
    /// A decoder that starts at `count` with the lines at these levels.
    pub fn new(decoding: Decoding, levels: (bool, bool), count: u16) -> Self {
        Self { decoding, last: levels, count, illegal: 0 }
    }

    /// The lines have these levels now.
    pub fn levels(&mut self, a: bool, b: bool) {
        let index = [self.last.0, self.last.1, a, b].iter().fold(0_usize, |i, &bit| 2 * i + usize::from(bit));
        let step = TRANSITIONS[index];
        let last = self.last;
        self.last = (a, b);
        if step == 2 {
            self.illegal += 1;
            return;
        }
        let counted = match self.decoding {
            Decoding::X4 => true,
            Decoding::X1 => !last.0 && !a,
        };
        if counted {
            self.count = self.count.wrapping_add_signed(i16::from(step));
        }
    }

    /// The counter.
    pub fn count(&self) -> u16 {
        self.count
    }

    /// Transitions of both lines at once.
    pub fn illegal_transitions(&self) -> u64 {
        self.illegal
    }
}

/// Disc and decoder: what the firmware reads.
#[derive(Clone, Debug)]
pub struct Encoder {
    disc: Disc,
    decoder: QuadratureDecoder,
    counts_per_turn: u32,
}

impl Encoder {
    /// An encoder of so many counts a turn after decoding, at an angle: ×4 of a quarter as many
    /// lines where that is a whole number above 256 (4096 counts: 1024 lines), otherwise ×1.
    ///
    /// The counter starts within half a turn of zero and so that count 0 begins at θ = 0, as on a
    /// board that has found the index mark.
    pub fn new(counts_per_turn: u32, angle: f64) -> Self {
        let (decoding, lines) = if counts_per_turn.is_multiple_of(4) && counts_per_turn > 1024 {
            (Decoding::X4, counts_per_turn / 4)
        } else {
            (Decoding::X1, counts_per_turn)
        };
        Self::with_decoding(lines, decoding, angle)
    }

    /// An encoder of so many lines.
    pub fn with_decoding(lines: u32, decoding: Decoding, angle: f64) -> Self {
        let counts_per_turn = match decoding {
            Decoding::X1 => lines,
            Decoding::X4 => lines.saturating_mul(4),
        };
        let disc = Disc::new(lines, angle);
        let n = i64::from(counts_per_turn.max(1));
        let within = count_of(angle, counts_per_turn).rem_euclid(n);
        let start = if within >= n - n / 2 { within - n } else { within };
        let decoder = QuadratureDecoder::new(decoding, disc.levels(), start as u16);
        Self { disc, decoder, counts_per_turn }
    }

    /// Counts a turn after decoding.
    pub fn counts_per_turn(&self) -> u32 {
        self.counts_per_turn
    }

    /// Turns the disc.
    pub fn turn_to(&mut self, angle: f64) {
        let decoder = &mut self.decoder;
        self.disc.turn_to(angle, |a, b| decoder.levels(a, b));
    }

    /// The counter begins anew at 0, wherever the disc stands: a chip that was reset.
    pub fn reset(&mut self) {
        self.decoder.count = 0;
    }

    /// The decoder.
    pub fn decoder(&self) -> &QuadratureDecoder {
        &self.decoder
    }
}

impl QuadratureCounter for Encoder {
    fn count(&mut self) -> u16 {
        self.decoder.count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Follows a path and extends the counter, as firmware does.
    fn follow(encoder: &mut Encoder, path: &[f64], mut count: i64) -> Vec<i64> {
        let mut last = encoder.decoder().count();
        path.iter()
            .map(|&angle| {
                encoder.turn_to(angle);
                let now = encoder.decoder().count();
                count += i64::from(now.wrapping_sub(last) as i16);
                last = now;
                count
            })
            .collect()
    }

    proptest! {
        #[test]
        fn the_decoded_count_is_the_floor_of_the_angle(
            start in -3.0f64..3.0, steps in prop::collection::vec(-6.0f64..6.0, 1..60), lines in 1u32..1400,
        ) {
            let mut path = vec![start];
            for step in steps {
                path.push(path[path.len() - 1] + step);
            }
            for decoding in [Decoding::X1, Decoding::X4] {
                let mut encoder = Encoder::with_decoding(lines, decoding, start);
                let n = encoder.counts_per_turn();
                let counts = follow(&mut encoder, &path, count_of(start, n));
                let floors: Vec<i64> = path.iter().map(|&angle| count_of(angle, n)).collect();
                prop_assert_eq!(counts, floors);
                prop_assert_eq!(encoder.decoder().illegal_transitions(), 0);
            }
        }
    }

    #[test]
    fn trembling_about_an_edge_counts_up_and_down() {
        let q = TAU / 4096.0;
        let mut encoder = Encoder::new(4096, 0.5 * q);
        let path = [1.5, 0.5, -0.5, -1.5, -0.5, 0.5, -0.01, 0.01].map(|x| x * q);
        assert_eq!(follow(&mut encoder, &path, 0), [1, 0, -1, -2, -1, 0, -1, 0]);
        let mut coarse = Encoder::new(1024, 0.5 * q);
        assert_eq!(follow(&mut coarse, &path, 0), [0, 0, -1, -1, -1, 0, -1, 0]);
    }

    #[test]
    fn both_lines_at_once_are_illegal_and_move_nothing() {
        let mut decoder = QuadratureDecoder::new(Decoding::X4, (false, false), 7);
        decoder.levels(true, true);
        assert_eq!((decoder.count(), decoder.illegal_transitions()), (7, 1));
        decoder.levels(true, true);
        decoder.levels(false, true);
        assert_eq!((decoder.count(), decoder.illegal_transitions()), (8, 1));
    }

    #[test]
    fn the_counter_wraps_and_long_jumps_end_soon() {
        let mut encoder = Encoder::new(4096, 0.0);
        encoder.turn_to(17.0 * TAU + 1e-6);
        assert_eq!(encoder.decoder().count(), (17_u32 * 4096) as u16);
        encoder.turn_to(1e12);
        assert_eq!(encoder.decoder().count(), count_of(1e12, 4096) as u16);
        encoder.turn_to(-1e300);
        encoder.turn_to(1e300);
        let start = Encoder::new(4096, 100.25 * TAU);
        assert_eq!(start.decoder().count(), 1024);
        let start = Encoder::new(1024, -0.25 * TAU);
        assert_eq!(start.decoder().count() as i16, -256);
    }
}
