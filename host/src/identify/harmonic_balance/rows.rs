//! Rows of the matrix equations (2.15), (3.17) to (3.20): one orbit's terms expanded in its
//! sub-harmonics.

use rustfft::FftPlanner;
use rustfft::num_complex::Complex64;
use serde::Serialize;

use super::equations::{Drive, Equations, Product};
use super::fourier::Fourier;
use super::orbit::{Motion, Orbit, motion};
use super::settings::{Settings, Subharmonics};

/// Which coefficient of a sub-harmonic a row equates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Part {
    /// j = 0.
    Mean,
    /// Coefficient of cos(jτ/k).
    Cos,
    /// Coefficient of sin(jτ/k).
    Sin,
}

/// Which row it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct RowId {
    /// Orbit.
    pub orbit: usize,
    /// Index j of the sub-harmonic j f_e/k.
    pub subharmonic: usize,
    /// k.
    pub periods: usize,
    /// Mean, cosine or sine.
    pub part: Part,
}

/// Rows of one equation.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    /// Which they are.
    pub ids: Vec<RowId>,
    /// Columns and then the target of each, row after row.
    pub values: Vec<f64>,
    /// Columns p.
    pub columns: usize,
}

impl Rows {
    /// Row r: p columns and the target.
    pub fn row(&self, r: usize) -> &[f64] {
        &self.values[r * (self.columns + 1)..(r + 1) * (self.columns + 1)]
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Appends another orbit's rows.
    pub fn append(&mut self, other: Self) {
        self.columns = other.columns;
        self.ids.extend(other.ids);
        self.values.extend(other.values);
    }
}

/// What one orbit gives: rows equation by equation, and the work of every term for the energy
/// balance.
#[derive(Clone, Debug)]
pub struct Expanded {
    /// Rows, equation by equation.
    pub rows: Vec<Rows>,
    /// ∫ X_j φ_e′ dτ over the orbit, equation by equation.
    pub work: Vec<Vec<f64>>,
    /// The orbit's motion at its ends.
    pub ends: [super::orbit::State; 2],
}

/// Highest sub-harmonic of an orbit that a low-pass at a share of the sampling rate lets through.
pub fn kept(samples: usize, low_pass: Option<f64>) -> Option<usize> {
    // Sub-harmonic j has j cycles over the n samples: j/n of the sampling rate.
    low_pass.map(|share| (share * samples as f64).floor() as usize)
}

/// Values of all factors along a motion, low-passed where they are to be.
fn factor_series(equations: &Equations, m: &Motion, fourier: &Fourier, keep: Option<usize>) -> Vec<Vec<f64>> {
    equations
        .factors
        .iter()
        .map(|f| {
            let x: Vec<f64> = m.states.iter().map(|s| (f.of)(s)).collect();
            match keep {
                Some(keep) if f.filtered => fourier.low_pass(&x, keep),
                _ => x,
            }
        })
        .collect()
}

/// A sum of products along the motion.
fn series(products: &[Product], factors: &[Vec<f64>], m: &Motion) -> Vec<f64> {
    let mut out = vec![0.0; m.states.len()];
    for p in products {
        for (i, y) in out.iter_mut().enumerate() {
            let drive = match p.drive {
                Drive::None => 1.0,
                Drive::Cos => m.tau[i].cos(),
                Drive::Sin => m.tau[i].sin(),
            };
            *y += p.scale * drive * p.factors.iter().map(|f| factors[*f][i]).product::<f64>();
        }
    }
    out
}

/// Expands an orbit.
pub fn expand(index: usize, orbit: &Orbit, equations: &Equations, settings: &Settings) -> Expanded {
    let fourier = Fourier::new(&mut FftPlanner::new(), orbit.len());
    let keep = kept(orbit.len(), settings.low_pass);
    let m = motion(orbit, &fourier, settings.differentiation, keep, equations.circle);
    let factors = factor_series(equations, &m, &fourier, keep);
    let step = std::f64::consts::TAU * orbit.periods as f64 / orbit.len() as f64;
    let mut rows = Vec::new();
    let mut work = Vec::new();
    for (e, terms) in equations.terms.iter().enumerate() {
        let columns: Vec<Vec<f64>> = terms.iter().map(|t| series(&t.products, &factors, &m)).collect();
        work.push(
            columns.iter().map(|x| step * x.iter().zip(&m.states).map(|(x, s)| x * s.rate[e]).sum::<f64>()).collect(),
        );
        let target: Vec<f64> = match equations.targets.get(e) {
            Some(products) => series(products, &factors, &m),
            None => m.states.iter().map(|s| -s.accel[e]).collect(),
        };
        let transforms: Vec<Vec<Complex64>> = columns.iter().chain([&target]).map(|x| fourier.of_real(x)).collect();
        let mut out = Rows { columns: terms.len(), ..Rows::default() };
        for j in chosen(orbit, &transforms[terms.len()], settings, keep) {
            let parts: &[Part] = if j == 0 { &[Part::Mean] } else { &[Part::Cos, Part::Sin] };
            for part in parts {
                out.ids.push(RowId { orbit: index, subharmonic: j, periods: orbit.periods, part: *part });
                out.values.extend(transforms.iter().map(|c| match part {
                    Part::Mean => c[0].re,
                    Part::Cos => 2.0 * c[j].re,
                    Part::Sin => -2.0 * c[j].im,
                }));
            }
        }
        rows.push(out);
    }
    Expanded { rows, work, ends: m.ends }
}

/// The sub-harmonics that are balanced, increasing.
fn chosen(orbit: &Orbit, acceleration: &[Complex64], settings: &Settings, keep: Option<usize>) -> Vec<usize> {
    let k = orbit.periods;
    let most = keep.unwrap_or(orbit.len()).min(orbit.len().saturating_sub(1) / 2);
    let mut out: Vec<usize> = match settings.subharmonics {
        Subharmonics::UpTo(f) => (1..=((f * k as f64) as usize).min(most)).collect(),
        Subharmonics::Harmonics(n) => (1..=n).map(|h| h * k).filter(|j| *j <= most).collect(),
        Subharmonics::Largest(n) => {
            let mut all: Vec<usize> = (1..=(3 * k).min(most)).collect();
            all.sort_by(|a, b| acceleration[*b].norm().total_cmp(&acceleration[*a].norm()).then(a.cmp(b)));
            all.truncate(n * k);
            all.sort_unstable();
            all
        }
    };
    if settings.mean_row {
        out.insert(0, 0);
    }
    out
}
