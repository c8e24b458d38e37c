//! Orbits of chapter 3's record, and Table 3.5: Fourier coefficients along one of them with and
//! without the low-pass.
//!
//! y = φ2′² sin Δ, Δ = φ2 − φ1, primes by τ = Ω t.

use rustfft::FftPlanner;

use super::chapter3::{PERIOD, extraction, table};
use super::data::{self, Data};
use super::{Reproduction, Row};
use crate::error::{BadInput, Result};
use crate::identify::harmonic_balance::fourier::Fourier;
use crate::identify::harmonic_balance::orbit::{MARGIN, Orbit, State, motion};
use crate::identify::harmonic_balance::rows::kept as passes;
use crate::identify::harmonic_balance::settings::Differentiation;

/// Orbits of the seed's record at a tolerance, and of its exact angles over the same stretches.
pub(super) fn found_orbits(tolerance: f64) -> Result<Vec<Orbit>> {
    data::double()?.orbits(PERIOD, &extraction(tolerance))
}

/// The best closing orbit of a period (the `index`-th best).
pub(super) fn orbit_of(all: &[Orbit], period: usize, index: usize) -> Result<&Orbit> {
    let mut of: Vec<&Orbit> = all.iter().filter(|o| o.periods == period).collect();
    of.sort_by(|a, b| a.closing_error.total_cmp(&b.closing_error));
    of.get(index).copied().ok_or_else(|| BadInput::new(format!("{} orbits of period {period}", of.len()), "more"))
}

/// y = φ2′² sin Δ and φ1′, φ1″ along an orbit, with or without the low-pass.
pub(super) fn along(orbit: &Orbit, filtered: bool, how: Differentiation) -> [Vec<f64>; 3] {
    let fourier = Fourier::new(&mut FftPlanner::new(), orbit.len());
    let keep = passes(orbit.len(), filtered.then_some(0.2));
    let m = motion(orbit, &fourier, how, keep, [true; 2]);
    let each = |f: &dyn Fn(&State) -> f64| m.states.iter().map(f).collect::<Vec<f64>>();
    let sin = each(&|s| (s.angle[1] - s.angle[0]).sin());
    let sin = keep.map_or(sin.clone(), |k| fourier.low_pass(&sin, k));
    let y = m.states.iter().zip(&sin).map(|(s, sin)| s.rate[1] * s.rate[1] * sin).collect();
    [each(&|s| s.rate[0]), each(&|s| s.accel[0]), y]
}

/// The same stretch of the angles before they were counted.
fn exact(orbit: &Orbit, data: &Data) -> Orbit {
    let start = (orbit.start_s * data.rig.sample_rate_hz).round() as usize - MARGIN;
    let phi = [0, 1].map(|c: usize| data.exact[c][start..start + orbit.phi[c].len()].to_vec());
    Orbit { phi, ..orbit.clone() }
}

pub(super) fn table_3_5() -> Result<Reproduction> {
    let data = data::double()?;
    let all = found_orbits(0.05)?;
    let orbit = orbit_of(&all, 9, 0)?;
    let fourier = Fourier::new(&mut FftPlanner::new(), orbit.len());
    let of = |y: &[f64]| fourier.of_real(y);
    let how = Differentiation::Fourier;
    let (without, with) = (of(&along(orbit, false, how)[2]), of(&along(orbit, true, how)[2]));
    let truth = of(&along(&exact(orbit, data), false, Differentiation::FivePoint)[2]);
    let printed = [
        [-3.2486, -0.3087, 0.0328, 0.0],
        [-34.0713, -27.1330, 17.7370, 17.7403],
        [-15.6946, -8.6732, -23.6908, -23.2652],
        [-31.2079, -24.1696, -10.2571, -10.6034],
    ];
    let mut rows = Vec::new();
    for (i, p) in printed.iter().enumerate() {
        let j = i + 1;
        let (cos, sin) = (
            |c: &[rustfft::num_complex::Complex64]| 2.0 * c[j].re,
            |c: &[rustfft::num_complex::Complex64]| -2.0 * c[j].im,
        );
        rows.push(Row::new(
            format!("cos {j}x, without filter"),
            "",
            Some(p[0]),
            Some(cos(&without)),
            Some(cos(&truth)),
        ));
        rows.push(Row::new(format!("cos {j}x, with filter"), "", Some(p[1]), Some(cos(&with)), Some(cos(&truth))));
        rows.push(Row::new(
            format!("sin {j}x, without filter"),
            "",
            Some(p[2]),
            Some(sin(&without)),
            Some(sin(&truth)),
        ));
        rows.push(Row::new(format!("sin {j}x, with filter"), "", Some(p[3]), Some(sin(&with)), Some(sin(&truth))));
    }
    Ok(table(
        "table-3.5",
        "Fourier coefficients of y = φ2′² sin(φ2 − φ1) of an orbit of period 9",
        rows,
        &[
            "Another orbit in another unit: the seed gives neither. Compare the two columns' differences. True: the angles before they were counted, \
             differentiated by five points, so that neither counts nor the jump are in it.",
        ],
    ))
}
