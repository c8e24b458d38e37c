//! The base's displacement from one tick to the next, and the points by which a converter plays it.
//!
//! A set point that stands from tick to tick is a staircase: beside the drive at f it holds images
//! at f_s ± f, whose amplitudes are f/(f_s ± f) of the drive's and whose accelerations are (f_s ±
//! f)/f times its own: 99 and 101 at 5 Hz and 500 Hz. Played at n points a tick they are gone;
//! those of the points lie n times as high, below a converter's step.
//!
//! Between the ticks y(u), u from 0 to 1, is the cubic with the values and the slopes of a(u) cos
//! φ(u) at both ends, the phase φ running evenly and the amplitude a along a line; of a form of
//! several components ([`whirl_shared::excitation::Form`]) their sum, or a table's. At the ticks it is
//! [`Shape::displacement`], bit for bit: what the host knows. Error in between: a ω⁴/384, ω the
//! advance of the phase in a tick (1.1e-5 a at 20 Hz and 500 Hz); of a table of one point a tick a D/48, D its
//! greatest second difference: a cubic has no corners in its second derivative.
//!
//! The points go on a little beyond the next tick, for an interrupt that is late; then the last one
//! stands. When the ticks come again the points approach the curve from what stands, by at most
//! [`CATCH_UP`] times the drive's greatest step from point to point.

use core::f32::consts::TAU;

use whirl_shared::excitation::{Form, Shape, Table};
use whirl_shared::waveform::{cos_sin, fixed, rounded};

/// Points that are played beyond a tick when the next one does not come: 0.2 ms of them at 40 kHz,
/// for the longest latency and the time in which the next run is computed ([`crate::player::LEAD`]).
pub const BEYOND: usize = 8;
/// How much faster than the drive itself the points may go while they catch up.
pub const CATCH_UP: f32 = 2.0;
/// Points a second that boards aim at: far above what a shaker follows, and a code's time is longer
/// than a converter's settling.
pub const POINTS_PER_SECOND: u32 = 40_000;

/// The drive from a tick to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sweep<'a> {
    /// Phase at the tick, turns · 2⁻³².
    pub phase: u32,
    /// Its advance until the next tick, turns · 2⁻³².
    pub phase_increment: u32,
    /// Amplitude at this tick and the next, nm.
    pub amplitude_nanometre: [u32; 2],
    /// What the displacement is at a phase.
    pub shape: Shape<'a>,
}

impl Sweep<'_> {
    /// Displacement at this tick, nm.
    #[must_use]
    pub fn start(&self) -> i32 {
        self.shape.displacement(self.amplitude_nanometre[0], self.phase)
    }

    /// Advance of the phase in a tick, rad.
    fn omega(&self) -> f32 {
        self.phase_increment as f32 * (TAU / 4_294_967_296.0)
    }

    /// Displacement (nm), to the last bit that of the shape, and slope (nm a tick) at both ticks.
    fn ends(&self) -> ([i32; 2], [f32; 2]) {
        match self.shape {
            Shape::Sines(form) => self.ends_of_sines(form),
            Shape::Table(table) => self.ends_of_table(table),
        }
    }

    fn ends_of_table(&self, table: &Table) -> ([i32; 2], [f32; 2]) {
        let [a, b] = self.amplitude_nanometre;
        let turns = self.phase_increment as f32 * (1.0 / 4_294_967_296.0);
        let end = |amplitude: u32, phase: u32| {
            let [share, slope] = table.slope(phase);
            let per_tick = (b as f32 - a as f32) * share + amplitude as f32 * turns * slope;
            (table.displacement(amplitude, phase), per_tick)
        };
        let (start, next) = (end(a, self.phase), end(b, self.phase.wrapping_add(self.phase_increment)));
        ([start.0, next.0], [start.1, next.1])
    }

    fn ends_of_sines(&self, form: &Form) -> ([i32; 2], [f32; 2]) {
        let (mut sums, mut slopes) = ([0_i64; 2], [0.0; 2]);
        let phases = [self.phase, self.phase.wrapping_add(self.phase_increment)];
        for component in form.components() {
            let amplitudes = self.amplitude_nanometre.map(|a| component.amplitude(a));
            let [a, b] = amplitudes.map(|a| a as f32);
            let omega = self.omega() * f32::from(component.harmonic);
            for (i, amplitude) in amplitudes.into_iter().enumerate() {
                let (cos, sin) = cos_sin::<f32>(component.angle(phases[i]));
                sums[i] = sums[i].saturating_add(i64::from(amplitude) * fixed(cos));
                slopes[i] += (b - a) * cos - amplitude as f32 * omega * sin;
            }
        }
        (sums.map(rounded), slopes)
    }

    /// Greatest step of the drive itself from one of `n` points a tick to the next, nm.
    fn step(&self, n: usize) -> f32 {
        let of = |[a, b]: [u32; 2], per_tick: f32| {
            let (a, b) = (a as f32, b as f32);
            a.max(b) * per_tick + (b - a).abs()
        };
        let step = match self.shape {
            Shape::Sines(form) => {
                let parts = form.components().map(|component| {
                    let amplitudes = self.amplitude_nanometre.map(|a| component.amplitude(a));
                    of(amplitudes, self.omega() * f32::from(component.harmonic))
                });
                parts.sum::<f32>()
            }
            Shape::Table(table) => {
                of(self.amplitude_nanometre, table.steepest() * self.phase_increment as f32 * (1.0 / 4_294_967_296.0))
            }
        };
        step / n as f32
    }
}

/// How displacements become codes: half of the range is rest, its ends are −full scale and +full
/// scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scale {
    /// Greatest code.
    pub max: u16,
    /// Displacement at the greatest code, nm; not 0.
    pub full_nanometre: u32,
}

impl Scale {
    /// The code of a displacement, (y + s)·max/2s rounded; none beyond the full scale s.
    #[must_use]
    pub fn code(self, nanometre: i32) -> Option<u16> {
        let (y, scale, max) = (i64::from(nanometre), i64::from(self.full_nanometre), i64::from(self.max));
        if y.abs() > scale {
            return None;
        }
        u16::try_from(((y + scale) * max + scale).div_euclid(2 * scale.max(1))).ok()
    }

    fn codes_per_nanometre(self) -> f32 {
        f32::from(self.max) / (2.0 * self.full_nanometre.max(1) as f32)
    }

    /// Writes the codes of a sweep, of which a tick takes `n`, behind point `now`, at which
    /// `standing` is the code that stands. Codes before are left as they are. None where the sweep
    /// leaves the full scale.
    #[must_use]
    pub fn fill(self, sweep: &Sweep<'_>, codes: &mut [u16], n: usize, now: usize, standing: u16) -> Option<()> {
        let (ends, [d0, d1]) = sweep.ends();
        let exact = [self.code(ends[0])?, self.code(ends[1])?];
        let [y0, y1] = ends.map(|y| y as f32);
        // The cubic in codes over points; half a code more, so that cutting rounds.
        let (gain, part) = (self.codes_per_nanometre(), 1.0 / n as f32);
        let c0 = f32::from(self.max) / 2.0 + gain * y0 + 0.5;
        let c1 = gain * part * d0;
        let c2 = gain * part * part * (3.0 * (y1 - y0) - 2.0 * d0 - d1);
        let c3 = gain * part * part * part * (2.0 * (y0 - y1) + d0 + d1);
        let curve = |k: f32| c0 + k * (c1 + k * (c2 + k * c3));
        // Rounding moves a code by half of one at each end.
        let most = CATCH_UP * sweep.step(n) * gain + 1.0;
        let mut at = f32::from(standing) + 0.5;
        // Points are far fewer than 2²⁴: counting them in floats is exact.
        let mut k = now as f32;
        let mut places = codes.iter_mut().skip(now + 1);
        for place in places.by_ref() {
            k += 1.0;
            let away = curve(k) - at;
            at += away.clamp(-most, most);
            *place = (at as u16).min(self.max);
            // From here on the curve's own steps are small enough.
            if away.abs() <= most {
                break;
            }
        }
        for place in places {
            k += 1.0;
            *place = (curve(k) as u16).min(self.max);
        }
        // At the next tick to the last bit, where the curve is there and may go there in a step.
        if let [.., before, place] = codes.get_mut(..=n).unwrap_or_default() {
            let before = if now + 1 < n { *before } else { standing };
            if now < n && place.abs_diff(exact[1]) <= 1 && f32::from(before.abs_diff(exact[1])) < most + 1.0 {
                *place = exact[1];
            }
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::{Rng, SeedableRng};
    use std::vec::Vec;

    const SCALE: Scale = Scale { max: 4_095, full_nanometre: 25_000_000 };
    const N: usize = 80;
    const FIVE_HERTZ: u32 = 42_949_673;

    fn sweep(tick: u32) -> Sweep<'static> {
        Sweep {
            phase: FIVE_HERTZ.wrapping_mul(tick),
            phase_increment: FIVE_HERTZ,
            amplitude_nanometre: [15_525_000; 2],
            shape: Shape::default(),
        }
    }

    /// A converter that plays points by a timer of its own: what stands at each point of time.
    struct Player {
        codes: [u16; N + BEYOND],
        /// The tick at which `codes` begin.
        tick: u32,
        from: usize,
        held: u16,
        played: Vec<u16>,
    }

    impl Player {
        fn new() -> Self {
            Self { codes: [2_048; N + BEYOND], tick: 0, from: 0, held: 2_048, played: Vec::new() }
        }

        /// The interrupt of a tick, `late` points after it, and `busy` more until the points are
        /// there.
        fn tick(&mut self, tick: u32, late: usize, busy: usize, sweep: &Sweep<'_>) {
            self.play_to(tick, late);
            let standing = self.held;
            let mut codes = self.codes;
            SCALE.fill(sweep, &mut codes, N, late, standing).unwrap();
            self.play_to(tick, late + busy);
            (self.codes, self.tick, self.from) = (codes, tick, late + busy + 1);
        }

        /// Plays up to a point of a tick.
        fn play_to(&mut self, tick: u32, point: usize) {
            while self.played.len() <= tick as usize * N + point {
                let behind = self.played.len() as i64 - i64::from(self.tick) * N as i64;
                if let Some(&code) =
                    usize::try_from(behind).ok().filter(|&k| k >= self.from).and_then(|k| self.codes.get(k))
                {
                    self.held = code;
                }
                self.played.push(self.held);
            }
        }
    }

    fn steps(played: &[u16]) -> u16 {
        played.windows(2).map(|pair| pair[0].abs_diff(pair[1])).max().unwrap_or(0)
    }

    #[test]
    fn at_the_ticks_it_is_the_accumulator_s_waveform_bit_for_bit() {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        let mut player = Player::new();
        for tick in 0..2_000 {
            // The interrupt's latency is some points now and then, and the points are there one
            // point later.
            let late = (random.next_u32() % (BEYOND as u32 - 1)) as usize * usize::from(tick % 3 == 0);
            player.tick(tick, late, usize::from(tick % 5 == 0), &sweep(tick));
        }
        // The first tick begins far from rest, and is caught up with.
        for tick in 40..2_000 {
            assert_eq!(player.played[tick as usize * N], SCALE.code(sweep(tick).start()).unwrap(), "tick {tick}");
        }
        // In between it is the cosine to a code.
        for (point, &code) in player.played.iter().enumerate().skip(40 * N) {
            let turns = f64::from(FIVE_HERTZ) / 4_294_967_296.0 * point as f64 / N as f64;
            let exact = 2_047.5 * (1.0 + 0.621 * libm::cos(core::f64::consts::TAU * turns));
            assert!((f64::from(code) - exact).abs() <= 1.01, "point {point}: {code} for {exact}");
        }
        assert!(steps(&player.played[40 * N..]) <= 2);
    }

    #[test]
    fn the_images_of_the_staircase_are_gone() {
        // Amplitude of the harmonics of 5 Hz beside 500 Hz, over one period of 100 ticks.
        let image = |code: &dyn Fn(usize) -> f64| {
            [99.0, 101.0].map(|order| {
                let (mut re, mut im) = (0.0, 0.0);
                for point in 0..100 * N {
                    let angle = core::f64::consts::TAU * order * point as f64 / (100 * N) as f64;
                    re += code(point) * libm::cos(angle);
                    im += code(point) * libm::sin(angle);
                }
                libm::sqrt(re * re + im * im) / (50 * N) as f64 / (0.621 * 2_047.5)
            })
        };
        let exact = |tick: usize| f64::from(SCALE.code(sweep(tick as u32).start()).unwrap());
        let stairs = image(&|point| exact(point / N));
        let mut player = Player::new();
        (0..250).for_each(|tick| player.tick(tick, 0, 0, &sweep(tick)));
        let played = image(&|point| f64::from(player.played[8_000 + point]));
        for (stairs, played) in stairs.into_iter().zip(played) {
            // Their acceleration is 99² and 101² times this: 99 times the drive's before, a tenth
            // of it now at most.
            assert!((0.0098..0.0103).contains(&stairs), "{stairs}");
            assert!(played < 1e-5, "{played}");
        }
    }

    #[test]
    fn a_ramp_goes_through_both_amplitudes() {
        let sweep = Sweep { amplitude_nanometre: [10_000_000, 10_040_000], ..sweep(7) };
        let mut codes = [0; N + BEYOND];
        let start = SCALE.code(sweep.start()).unwrap();
        SCALE.fill(&sweep, &mut codes, N, 0, start).unwrap();
        assert_eq!(codes[N], SCALE.code(sweep.ends().0[1]).unwrap());
        assert_eq!(codes[0], 0);
        assert!(codes[1].abs_diff(start) <= 1);
    }

    #[test]
    fn a_table_is_played_through_its_ticks_and_within_a_corner_between_them() {
        // One point a tick, as sharp as can be; and twenty points in two hundred ticks.
        for (points, increment, bound) in
            [(100_usize, FIVE_HERTZ, 8_000.0 / 32_768.0 / 48.0), (20, FIVE_HERTZ / 2, 1e-4)]
        {
            let sharp =
                |j: usize| if points == 100 { 2_000 * (1 - 2 * (j as i16 % 2)) } else { 300 * (j as i16 - 10).abs() };
            let table = Table::of(&(0..points).map(sharp).collect::<Vec<i16>>()).unwrap();
            let of = |tick: u32| Sweep {
                phase: increment.wrapping_mul(tick),
                phase_increment: increment,
                shape: Shape::Table(&table),
                ..sweep(0)
            };
            let mut player = Player::new();
            (0..400).for_each(|tick| player.tick(tick, 0, 0, &of(tick)));
            for (point, &code) in player.played.iter().enumerate().skip(40 * N) {
                let phase = (u64::from(increment) * point as u64 / N as u64) as u32;
                let y = f64::from(table.displacement(15_525_000, phase));
                let exact = 2_047.5 * (1.0 + y / 25e6);
                let away = (f64::from(code) - exact).abs();
                assert!(away <= 1.01 + bound * 0.621 * 2_047.5, "point {point}: {code} for {exact}");
                if point % N == 0 {
                    assert_eq!(Some(code), SCALE.code(of((point / N) as u32).start()));
                }
            }
            let own = f64::from(of(0).step(N) * SCALE.codes_per_nanometre());
            assert!(f64::from(steps(&player.played[40 * N..])) <= own + 2.0, "{own}");
        }
    }

    #[test]
    fn beyond_full_scale_is_refused() {
        let beyond = Sweep { amplitude_nanometre: [25_000_000, 25_000_001], phase: 0, phase_increment: 0, ..sweep(0) };
        assert_eq!(SCALE.fill(&beyond, &mut [0; N], N, 0, 2_048), None);
        assert_eq!(SCALE.code(i32::MIN), None);
        assert_eq!(Scale { max: 4_095, full_nanometre: 0 }.code(0), Some(0));
    }
}
