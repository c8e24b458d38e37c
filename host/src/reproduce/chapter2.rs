//! Chapter 2: the horizontally driven single pendulum, simulated, identified from its unstable
//! periodic orbits.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use super::data::{self, Data, SINGLE_PERIOD};
use super::drawing::{delayed, function, portrait, wrapped};
use super::{Item, Reproduction, Row};
use crate::error::{BadInput, Result};
use crate::identify::Identification;
use crate::identify::harmonic_balance::account::Function;
use crate::identify::harmonic_balance::orbit::{MARGIN, Orbit};
use crate::identify::harmonic_balance::settings::{Basis, EnergyBalance, Orbits, Settings};
use crate::phase_space::average_mutual_information::{average_mutual_information, minima};
use crate::phase_space::false_nearest_neighbours::{self, dimension, false_nearest_neighbours};
use crate::phase_space::observable::Observable;
use crate::report::figures::axis::Axis;
use crate::report::figures::canvas::{Panel, Series, Shape};

/// Items of this file.
pub static ITEMS: &[Item] = &[
    Item {
        id: "figure-2.1",
        about: "single pendulum: a period-4 orbit, wrapped, unwrapped, rotation and oscillation",
        run: figure_2_1,
    },
    Item {
        id: "figure-2.2",
        about: "single pendulum: reconstructed phase plane and Poincaré section",
        run: figure_2_2,
    },
    Item { id: "figure-2.3", about: "single pendulum: average mutual information", run: figure_2_3 },
    Item { id: "figure-2.4", about: "single pendulum: orbits of periods one and two", run: figure_2_4 },
    Item { id: "table-2.1", about: "single pendulum: coefficients in the harmonic basis", run: table_2_1 },
    Item { id: "figure-2.5", about: "single pendulum: n in the interpolation basis", run: || unknown("figure-2.5", 0) },
    Item { id: "figure-2.6", about: "single pendulum: p in the interpolation basis", run: || unknown("figure-2.6", 1) },
    Item { id: "figure-2.7", about: "single pendulum: q in the interpolation basis", run: || unknown("figure-2.7", 2) },
    Item { id: "figure-2.8", about: "single pendulum: Poincaré sections of the identified systems", run: figure_2_8 },
    Item {
        id: "energy-balance-c_r",
        about: "single pendulum: c_r by energy balance (section 3.5)",
        run: energy_balance,
    },
];

/// Lag of the embedding.
const DELAY: usize = 5;

/// The seed's extraction: 3 %, periods 1 to 16, T_d = 5.
fn extraction() -> Orbits {
    Orbits::Unstable { tolerance: 0.03, longest: 16, delay: Some(DELAY) }
}

fn settings(basis: Basis) -> Settings {
    Settings { orbits: extraction(), basis, low_pass: None, optimisation: None, ..Settings::frequency(60) }
}

fn kept(
    cell: &'static OnceLock<Result<Identification>>,
    make: fn() -> Result<Identification>,
) -> Result<&'static Identification> {
    cell.get_or_init(make).as_ref().map_err(Clone::clone)
}

fn harmonic() -> Result<&'static Identification> {
    static FOUND: OnceLock<Result<Identification>> = OnceLock::new();
    kept(&FOUND, || data::single()?.balance(&settings(Basis::Harmonic(1))))
}

fn interpolated() -> Result<&'static Identification> {
    static FOUND: OnceLock<Result<Identification>> = OnceLock::new();
    kept(&FOUND, || data::single()?.balance(&settings(Basis::Interpolation(8))))
}

/// The weak form of the clean record.
pub(super) fn weak() -> Result<&'static Identification> {
    static FOUND: OnceLock<Result<Identification>> = OnceLock::new();
    kept(&FOUND, || data::single()?.weak())
}

fn value(found: &Identification, name: &str) -> Option<f64> {
    found.parameter(name).map(|p| p.value)
}

/// Row of a coefficient.
fn row(name: &str, printed: Option<f64>, found: &Identification, data: &Data) -> Result<Row> {
    Ok(Row::new(name, "", printed, value(found, name), data.truth(name)).ours(value(weak()?, name)))
}

/// The extracted orbits, best closing first among those of one period.
fn found_orbits() -> Result<Vec<Orbit>> {
    let data = data::single()?;
    data.orbits(SINGLE_PERIOD as f64, &extraction())
}

fn samples(orbit: &Orbit) -> &[f64] {
    &orbit.phi[0][MARGIN..MARGIN + orbit.len()]
}

fn figure_2_1() -> Result<Reproduction> {
    let all = found_orbits()?;
    // A whirling one shows what the figure is about.
    let turns = |o: &Orbit| (o.phi[0][MARGIN + o.len()] - o.phi[0][MARGIN]) / TAU;
    let orbit = all
        .iter()
        .filter(|o| o.periods == 4)
        .max_by(|a, b| turns(a).abs().round().total_cmp(&turns(b).abs().round()))
        .or_else(|| all.iter().find(|o| turns(o).abs() > 0.5))
        .ok_or_else(|| BadInput::new("no orbit that whirls", "one of period 4"))?;
    let x = samples(orbit);
    let w = turns(orbit).round();
    let rotation: Vec<f64> = (0..x.len()).map(|i| TAU * w * i as f64 / x.len() as f64).collect();
    let t: Vec<f64> = (0..x.len()).map(|i| i as f64 / SINGLE_PERIOD as f64).collect();
    let panel = |title: &str, label: &str, y: Vec<f64>, shape| {
        let mut p = Panel::new(title, Axis::linear("t / T"), Axis::linear(label));
        p.series.push(Series::new("", shape, t.clone(), y));
        p
    };
    let mut parts = panel("(c)", "parts / rad", rotation.clone(), Shape::Line);
    parts.series[0].name = "rotation ω_{ck} t".into();
    let oscillation: Vec<f64> = x.iter().zip(&rotation).map(|(v, r)| v - x[0] - r).collect();
    parts.series.push(Series::new("oscillation x_{var}", Shape::Line, t.clone(), oscillation.clone()));
    let panels = vec![
        panel("(a)", "θ / rad", x.iter().map(|x| wrapped(*x)).collect(), Shape::Dots),
        panel("(b)", "θ_{c} / rad", x.iter().map(|v| v - x[0]).collect(), Shape::Line),
        parts,
    ];
    let jump = orbit.phi[0][MARGIN + orbit.len()] - x[0] - TAU * w;
    Ok(Reproduction {
        id: "figure-2.1".into(),
        title: format!(
            "a whirling orbit of period {}: (a) sampled, (b) continuous, (c) rotation and oscillation",
            orbit.periods
        ),
        rows: vec![
            Row::new("turns over the orbit", "", None, Some(w), None),
            Row::new("jump of the oscillation where it should close", "rad", None, Some(jump), None),
        ],
        notes: vec!["The orbit is one of those extracted here from the simulated record.".into()],
        panels: (panels, 3, 220.0),
    })
}

/// Samples at phase 0 of the drive: θ and θ′ by five points.
fn section(x: &[f64], period: usize) -> (Vec<f64>, Vec<f64>) {
    let h = TAU / period as f64;
    (period..x.len().saturating_sub(3))
        .step_by(period)
        .map(|i| (wrapped(x[i]), (8.0 * (x[i + 1] - x[i - 1]) - x[i + 2] + x[i - 2]) / (12.0 * h)))
        .unzip()
}

/// A panel of a section.
pub(super) fn section_panel(title: &str, x: &[f64]) -> Panel {
    let (a, b) = section(x, SINGLE_PERIOD);
    let mut p = Panel::new(title, Axis::angle("θ / rad"), Axis::linear("θ′"));
    p.series.push(Series::new("", Shape::Dots, a, b));
    p
}

fn figure_2_2() -> Result<Reproduction> {
    let x = &data::single()?.exact[0];
    let (a, b) = delayed(x, DELAY);
    let plane =
        portrait("(a) reconstructed phase plane", ["θ(t) / rad", "θ(t + 5) / rad"], a.into_iter(), b.into_iter());
    let o = Observable::angle(&[x], 0.0, 1);
    let choice =
        false_nearest_neighbours::Settings { dimensions: 8, theiler: SINGLE_PERIOD as u32, ..Default::default() };
    let false_share = false_nearest_neighbours(&o, DELAY, &choice);
    let found = dimension(&false_share.share, 0.02);
    Ok(Reproduction {
        id: "figure-2.2".into(),
        title: "reconstructed phase plane and Poincaré section".into(),
        rows: vec![
            Row::new("embedding dimension, false neighbours below 2 %", "", Some(4.0), found.map(|d| d as f64), None),
            Row::new("points", "", Some(30_000.0), Some(x.len() as f64), None),
        ],
        notes: vec![
            "f 1.52, c_r 0.036, 1/r² 1.44: the one consistent reading of the two values of friction that are printed."
                .into(),
        ],
        panels: (vec![plane, section_panel("(b) Poincaré section, τ = 0", x)], 2, 320.0),
    })
}

fn figure_2_3() -> Result<Reproduction> {
    let x = &data::single()?.exact[0];
    let bits = average_mutual_information(&Observable::angle(&[x], 0.0, 1), 30, 64).bits;
    let first = minima(&bits).first().map(|m| m.lag as f64);
    let mut panel = Panel::new("", Axis::linear("lag dt / samples"), Axis::linear("I(dt) / bit"));
    panel.series.push(Series::new("", Shape::Line, (1..=bits.len()).map(|i| i as f64).collect(), bits));
    Ok(Reproduction {
        id: "figure-2.3".into(),
        title: "average mutual information of the angle".into(),
        rows: vec![Row::new("lag of the first minimum", "samples", Some(5.0), first, None)],
        notes: Vec::new(),
        panels: (vec![panel], 1, 260.0),
    })
}

fn figure_2_4() -> Result<Reproduction> {
    let all = found_orbits()?;
    let mut chosen: Vec<&Orbit> = all.iter().filter(|o| o.periods == 1).take(1).collect();
    chosen.extend(all.iter().filter(|o| o.periods == 2).take(3));
    let panels = chosen
        .iter()
        .zip(["(a)", "(b)", "(c)", "(d)"])
        .map(|(o, title)| {
            let n = o.len();
            let x = samples(o);
            let later: Vec<f64> = (0..n).map(|i| x[(i + DELAY) % n]).collect();
            let title = format!("{title} period {}", o.periods);
            portrait(&title, ["θ(t) / rad", "θ(t + 5) / rad"], x.iter().copied(), later.into_iter())
        })
        .collect();
    Ok(Reproduction {
        id: "figure-2.4".into(),
        title: "orbits of periods one and two".into(),
        rows: vec![Row::new("distinct orbits of periods 1 to 16 at 3 %", "", Some(25.0), Some(all.len() as f64), None)],
        notes: vec![
            "Orbits count as one where they lie nowhere farther apart than two tolerances; the seed does not say how it merged.".into(),
        ],
        panels: (panels, 2, 240.0),
    })
}

fn table_2_1() -> Result<Reproduction> {
    let (data, found) = (data::single()?, harmonic()?);
    let printed = [
        ("n_cos", 0.009),
        ("n_sin", 0.003),
        ("p_cos", -1.526),
        ("p_sin", 0.0),
        ("q_cos", -0.004),
        ("q_sin", 1.434),
        ("c_r", 0.0339),
    ];
    Ok(Reproduction {
        id: "table-2.1".into(),
        title: "coefficients in the harmonic basis, K = 1, from extracted orbits".into(),
        rows: printed.iter().map(|(n, p)| row(n, Some(*p), found, data)).collect::<Result<_>>()?,
        notes: vec![
            "The reproduced values carry the closing errors of orbits extracted at 3 %; the weak form has none.".into(),
        ],
        panels: Default::default(),
    })
}

/// Functions of an identification.
pub(super) fn functions(found: &Identification) -> &[Function] {
    found.balance.as_ref().map_or(&[], |b| b.functions.as_slice())
}

/// The true n, p or q.
pub(super) fn true_function(i: usize) -> impl Fn(f64) -> f64 {
    move |x: f64| match i {
        0 => 0.0,
        1 => -1.52 * x.cos(),
        _ => 1.44 * x.sin(),
    }
}

/// Rms deviation of an identified function from the true one.
pub(super) fn deviation(f: &Function, i: usize) -> f64 {
    let truth = true_function(i);
    let square: f64 = f.angle.iter().zip(&f.value).map(|(x, y)| (y - truth(*x)).powi(2)).sum();
    (square / f.angle.len().max(1) as f64).sqrt()
}

fn unknown(id: &str, i: usize) -> Result<Reproduction> {
    let (data, found) = (data::single()?, interpolated()?);
    let f = functions(found).get(i).ok_or_else(|| BadInput::new("no functions", "three"))?;
    Ok(Reproduction {
        id: id.into(),
        title: format!("{}(θ) in the interpolation basis of eight points, with its pointwise band", f.name),
        rows: vec![
            row("c_r", Some(0.0348), found, data)?,
            Row::new(
                format!("rms deviation of {} from the true function", f.name),
                "",
                None,
                Some(deviation(f, i)),
                Some(0.0),
            ),
        ],
        notes: vec!["The band is that of the coefficients; that eight chords are no cosine is not in it.".into()],
        panels: (vec![function(f, true_function(i), 8)], 1, 280.0),
    })
}

/// The identified system, integrated by Runge and Kutta's fourth-order method, 100 steps a period;
/// 25 samples a period.
pub(super) fn identified_motion(found: &Identification, periods: usize) -> Vec<f64> {
    let c_r = value(found, "c_r").unwrap_or(0.0);
    let functions = functions(found);
    let at = |i: usize, x: f64| {
        functions.get(i).map_or(0.0, |f| {
            // The functions are given evenly over the circle, the last point being the first.
            let n = f.value.len() - 1;
            let u = (wrapped(x) / TAU + 0.5) * n as f64;
            let k = (u.floor() as usize).min(n - 1);
            f.value[k] + (u - k as f64) * (f.value[k + 1] - f.value[k])
        })
    };
    let rate = |t: f64, s: [f64; 2]| [s[1], -c_r * s[1] - at(0, s[0]) * t.cos() - at(1, s[0]) * t.sin() - at(2, s[0])];
    let steps = 4 * SINGLE_PERIOD;
    let h = TAU / steps as f64;
    let (mut s, mut out) = ([0.3, 0.5], Vec::new());
    for i in 0..(periods + 40) * steps {
        if i >= 40 * steps && i % 4 == 0 {
            out.push(s[0]);
        }
        let t = h * (i % steps) as f64;
        let add = |a: [f64; 2], b: [f64; 2], f: f64| [a[0] + f * b[0], a[1] + f * b[1]];
        let k1 = rate(t, s);
        let k2 = rate(t + 0.5 * h, add(s, k1, 0.5 * h));
        let k3 = rate(t + 0.5 * h, add(s, k2, 0.5 * h));
        let k4 = rate(t + h, add(s, k3, h));
        for c in 0..2 {
            s[c] += h / 6.0 * (k1[c] + 2.0 * k2[c] + 2.0 * k3[c] + k4[c]);
        }
    }
    out
}

/// Mean absolute rate of a motion, a number to compare sections by.
pub(super) fn spread(x: &[f64]) -> f64 {
    let (_, rates) = section(x, SINGLE_PERIOD);
    (rates.iter().map(|r| r * r).sum::<f64>() / rates.len().max(1) as f64).sqrt()
}

fn figure_2_8() -> Result<Reproduction> {
    let truth = &data::single()?.exact[0];
    let a = identified_motion(interpolated()?, 1200);
    let b = identified_motion(harmonic()?, 1200);
    let row = |name: &str, x: &[f64]| Row::new(name, "", None, Some(spread(x)), Some(spread(truth)));
    Ok(Reproduction {
        id: "figure-2.8".into(),
        title: "Poincaré sections of the identified systems beside the original".into(),
        rows: vec![row("rms θ′ at τ = 0, interpolation basis", &a), row("rms θ′ at τ = 0, harmonic basis", &b)],
        notes: vec![
            "The sections are judged by eye in the seed; the rms velocity on them is a number for the same.".into(),
        ],
        panels: (
            vec![
                section_panel("(a) interpolation basis", &a),
                section_panel("(b) harmonic basis", &b),
                section_panel("original", truth),
            ],
            3,
            260.0,
        ),
    })
}

fn energy_balance() -> Result<Reproduction> {
    let data = data::single()?;
    let seed = data.balance(&Settings { energy_balance: EnergyBalance::Equations, ..settings(Basis::Harmonic(1)) })?;
    let whole = data.balance(&Settings { energy_balance: EnergyBalance::Coupled, ..settings(Basis::Harmonic(1)) })?;
    Ok(Reproduction {
        id: "energy-balance-c_r".into(),
        title: "c_r by the energy balance (3.38)".into(),
        rows: vec![
            row("c_r", Some(0.0353), &seed, data)?,
            Row::new("c_r, energies at both ends measured", "", None, value(&whole, "c_r"), data.truth("c_r")),
            Row::new(
                "c_r of the harmonic balance before it",
                "",
                Some(0.0339),
                value(harmonic()?, "c_r"),
                data.truth("c_r"),
            ),
        ],
        notes: vec!["The seed takes conservative terms to vanish although its orbits close to 3 % only.".into()],
        panels: Default::default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_runs_and_the_seeds_method_is_near_the_truth() {
        for item in ITEMS {
            let r = (item.run)().unwrap();
            assert_eq!(r.id, item.id);
            assert!(r.rows.iter().all(|row| row.reproduced.is_some_and(f64::is_finite)), "{} {:?}", r.id, r.rows);
            assert!(item.id.starts_with("figure") != r.panels.0.is_empty(), "{}", r.id);
        }
        for row in table_2_1().unwrap().rows {
            let (found, truth, ours) = (row.reproduced.unwrap(), row.truth.unwrap(), row.ours.unwrap());
            assert!((found - truth).abs() < 0.05, "{} {found} {truth}", row.quantity);
            assert!((ours - truth).abs() < 1e-8, "{} {ours}", row.quantity);
        }
    }
}
