//! Poincaré sections of the measured record and of the model's own, side by side.

use serde::Serialize;

use core::f64::consts::PI;

use super::energy_distance::{Among, among};
use super::result::Labelled;
use crate::inspect::coordinate::Coordinate;
use crate::inspect::motion::Space;
use crate::phase_space::poincare_section::Section;
use crate::phase_space::survey::PhaseSpace;

/// Two sections at one phase of the drive.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SectionComparison {
    /// Phase of the drive, rad.
    pub tau: f64,
    /// Names of the coordinates.
    pub names: Vec<String>,
    /// The same, as pages label them.
    #[serde(skip)]
    pub of: Vec<Labelled>,
    /// Measured.
    pub measured: Section,
    /// Of the model's own record.
    pub simulated: Section,
    /// Where the measured one stands among those of the model's own records; none with too few
    /// points.
    pub test: Option<Among>,
}

/// All sections; none where either record has none or repeats. `others` are those of further records
/// of the model, `known` the record's coordinates.
pub fn compare(
    measured: &PhaseSpace,
    simulated: &PhaseSpace,
    others: &[Vec<Section>],
    known: &[Coordinate],
) -> Vec<SectionComparison> {
    let names: Vec<String> = measured.coordinates.iter().map(|c| c.name.clone()).collect();
    let of: Vec<Labelled> = names.iter().map(|n| label(n, known)).collect();
    // What is recorded of an input is no motion: a base that was measured is not what it does to the
    // model in any other record.
    let is_input = |n: &String| known.iter().any(|c| c.name == *n && c.input);
    let kinds: Vec<Kind> =
        of.iter().zip(&names).map(|(l, n)| Kind { is_angle: l.is_angle, is_input: is_input(n) }).collect();
    // A record that repeats has no exponent; its sections are a few points that no test tells apart
    // by distance.
    if measured.lyapunov.is_none() || simulated.lyapunov.is_none() || simulated.coordinates.len() != names.len() {
        return Vec::new();
    }
    measured
        .sections
        .iter()
        .zip(&simulated.sections)
        .enumerate()
        .map(|(k, (a, b))| {
            let all: Vec<&Section> = [a, b].into_iter().chain(others.iter().filter_map(|o| o.get(k))).collect();
            let clouds = features(&all, &kinds);
            SectionComparison {
                tau: a.tau,
                names: names.clone(),
                of: of.clone(),
                measured: a.clone(),
                simulated: b.clone(),
                test: among(&clouds[0], &clouds[1..]),
            }
        })
        .collect()
}

fn label(name: &str, known: &[Coordinate]) -> Labelled {
    let c = known.iter().find(|c| c.name == name);
    Labelled {
        name: name.to_owned(),
        unit: c.map_or_else(|| "1".to_owned(), |c| c.unit.clone()),
        is_angle: c.is_some_and(|c| c.space == Space::S1),
        turns: c.is_some_and(|c| c.space == Space::S1 && (c.greatest > PI || c.least < -PI)),
    }
}

/// What a recorded quantity is.
#[derive(Clone, Copy)]
struct Kind {
    is_angle: bool,
    is_input: bool,
}

/// Points of each section as features of equal weight, whatever their units: cosine and sine of each
/// angle, and each length and velocity over its scatter in all of them together.
fn features(all: &[&Section], kinds: &[Kind]) -> Vec<Vec<Vec<f64>>> {
    let coordinates = all.iter().map(|s| s.value.len()).min().unwrap_or(0).min(kinds.len());
    let scatters = |of: &dyn Fn(&Section) -> &[Vec<f32>]| -> Vec<f64> {
        (0..coordinates).map(|c| scatter(&all.iter().map(|s| &of(s)[c][..]).collect::<Vec<_>>())).collect()
    };
    let (of_value, of_velocity) = (scatters(&|s| &s.value), scatters(&|s| &s.velocity));
    let points = |s: &&Section| -> Vec<Vec<f64>> {
        let n = s.value.iter().map(Vec::len).min().unwrap_or(0);
        let one = |i: usize| {
            let mut out = Vec::with_capacity(3 * coordinates);
            for c in (0..coordinates).filter(|c| !kinds[*c].is_input) {
                let x = f64::from(s.value[c][i]);
                if kinds[c].is_angle {
                    out.extend([x.cos(), x.sin()])
                } else {
                    out.push(x / of_value[c])
                }
                out.push(f64::from(s.velocity[c][i]) / of_velocity[c]);
            }
            out
        };
        (0..n).map(one).collect()
    };
    all.iter().map(points).collect()
}

/// Standard deviation of all values together; 1 where they do not differ.
fn scatter(parts: &[&[f32]]) -> f64 {
    let all: Vec<f64> = parts.iter().flat_map(|p| p.iter()).map(|v| f64::from(*v)).collect();
    let count = all.len().max(1) as f64;
    let mean = all.iter().sum::<f64>() / count;
    let variance = all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
    if variance > 0.0 { variance.sqrt() } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind(is_angle: bool) -> Kind {
        Kind { is_angle, is_input: false }
    }

    #[test]
    fn a_length_counts_as_much_in_any_unit() {
        let section = |scale: f32, shift: f32, first: f32| {
            let x: Vec<f32> = (0..50).map(|i| scale * (((first + i as f32) * 0.7).sin() + shift)).collect();
            let v: Vec<f32> = (0..50).map(|i| scale * ((first + i as f32) * 1.3).cos()).collect();
            Section { tau: 0.0, value: vec![x], velocity: vec![v] }
        };
        let p = |scale: f32| {
            let others = [3.3, 7.9, 11.2, 17.7].map(|first| section(scale, 0.0, first));
            let own = section(scale, 1.5, 0.0);
            let clouds = features(&std::iter::once(&own).chain(&others).collect::<Vec<_>>(), &[kind(false)]);
            (clouds[0][0].len(), among(&clouds[0], &clouds[1..]).unwrap().p_value)
        };
        // A millimetre's cosine is 1 wherever the motion is.
        assert!(p(1e-3).1 < 0.02 && (p(1e-3).1 - p(1.0).1).abs() < 1e-3, "{:?} {:?}", p(1e-3), p(1.0));
        let x = &features(&[&section(1.0, 0.0, 0.0)], &[kind(true)])[0];
        assert_eq!((p(1.0).0, x[0].len()), (2, 3));
        // An input beside it makes no feature.
        let both = Section { tau: 0.0, value: vec![vec![0.5; 9]; 2], velocity: vec![vec![0.1; 9]; 2] };
        let kinds = [kind(true), Kind { is_angle: false, is_input: true }];
        assert_eq!(features(&[&both], &kinds)[0][0].len(), 3);
    }
}
