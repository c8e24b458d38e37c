//! Chapter 3's figures.

use std::f64::consts::TAU;

use super::chapter3::{DELAY, PERIOD, error_rows, optimised, plain, settings as seed_settings};
use super::chapter3_orbits::{along, found_orbits, orbit_of};
use super::data;
use super::drawing::{angles, curve, residuals, views};
use super::{Item, Reproduction, Row};
use crate::error::Result;
use crate::identify::harmonic_balance::fourier::Fourier;
use crate::identify::harmonic_balance::orbit::Orbit;
use crate::identify::harmonic_balance::settings::{Differentiation, Orbits};
use crate::phase_space::average_mutual_information::{average_mutual_information, minima};
use crate::phase_space::observable::Observable;
use crate::report::figures::axis::Axis;
use crate::report::figures::canvas::{Panel, Series, Shape};

/// Items of this file.
pub static ITEMS: &[Item] = &[
    Item { id: "figure-3.1", about: "double pendulum: sketch", run: figure_3_1 },
    Item { id: "figure-3.2", about: "double pendulum: average mutual information", run: figure_3_2 },
    Item { id: "figure-3.3", about: "double pendulum: phase portraits of the record", run: figure_3_3 },
    Item { id: "figure-3.4", about: "double pendulum: a period-4 orbit", run: || orbit("figure-3.4", 4, 0) },
    Item { id: "figure-3.5", about: "double pendulum: a period-9 orbit", run: || orbit("figure-3.5", 9, 0) },
    Item { id: "figure-3.6", about: "double pendulum: a period-12 orbit", run: || orbit("figure-3.6", 12, 0) },
    Item { id: "figure-3.7", about: "double pendulum: another period-12 orbit", run: || orbit("figure-3.7", 12, 1) },
    Item { id: "figure-3.8", about: "double pendulum: a period-15 orbit", run: || orbit("figure-3.8", 15, 0) },
    Item { id: "figure-3.9", about: "double pendulum: another period-15 orbit", run: || orbit("figure-3.9", 15, 1) },
    Item { id: "figure-3.10", about: "double pendulum: phase portraits of the simulated system", run: figure_3_10 },
    Item { id: "figure-3.11", about: "double pendulum: spectra with and without low-pass", run: figure_3_11 },
    Item { id: "figure-3.12", about: "double pendulum: signals with and without low-pass", run: figure_3_12 },
    Item {
        id: "figure-3.13",
        about: "double pendulum: the jump, by Fourier series and by five points",
        run: figure_3_13,
    },
    Item { id: "figure-3.14", about: "double pendulum: residuals before the optimisation", run: figure_3_14 },
    Item { id: "figure-3.15", about: "double pendulum: residuals after the optimisation", run: figure_3_15 },
];

fn made(id: &str, title: &str, rows: Vec<Row>, notes: &[&str], panels: (Vec<Panel>, usize, f64)) -> Reproduction {
    let notes = notes.iter().map(|n| (*n).to_owned()).collect();
    Reproduction { id: id.into(), title: title.into(), rows, notes, panels }
}

/// The two arms from the moving base, to scale: l1 = 63.5 mm, l2 = 53.4 mm, at φ1 = 35°, φ2 = 70°.
fn figure_3_1() -> Result<Reproduction> {
    let (l1, l2): (f64, f64) = (0.0635, 0.0534);
    let (a, b) = (35_f64.to_radians(), 70_f64.to_radians());
    let joint = [l1 * a.sin(), -l1 * a.cos()];
    let tip = [joint[0] + l2 * b.sin(), joint[1] - l2 * b.cos()];
    let along = |p: [f64; 2], q: [f64; 2]| -> (Vec<f64>, Vec<f64>) {
        (0..=10).map(|i| f64::from(i) / 10.0).map(|u| (p[0] + u * (q[0] - p[0]), p[1] + u * (q[1] - p[1]))).unzip()
    };
    let mut panel = Panel::new("", Axis::linear("m").range(-0.05, 0.15), Axis::linear("m").range(-0.1, 0.03));
    let parts = [
        ("base, y(t) upward", along([-0.03, 0.0], [0.03, 0.0]), 3),
        ("arm 1, θ_{1} = φ_{1} from hanging", along([0.0, 0.0], joint), 0),
        ("arm 2, θ_{2} = φ_{2} − φ_{1} from arm 1", along(joint, tip), 1),
        ("hanging", along([0.0, 0.0], [0.0, -0.08]), 4),
    ];
    for (name, (x, y), colour) in parts {
        panel.series.push(Series::new(name, Shape::Line, x, y).colour(colour));
    }
    let e = |from: [f64; 2], angle: f64, e: f64| [from[0] + e * angle.sin(), from[1] - e * angle.cos()];
    let (c1, c2) = (e([0.0, 0.0], a, 0.0127), e(joint, b, 0.0267));
    panel.series.push(
        Series::new("centroids at e_{1}, e_{2}", Shape::BigDots, vec![c1[0], c2[0]], vec![c1[1], c2[1]]).colour(2),
    );
    Ok(made("figure-3.1", "sketch of the double pendulum, to scale", Vec::new(), &[], (vec![panel], 1, 320.0)))
}

/// θ1 and θ2 of the seed's record before counting.
fn record() -> Result<[Vec<f64>; 2]> {
    let data = data::double()?;
    Ok([data.exact[0].clone(), data.exact[1].iter().zip(&data.exact[0]).map(|(b, a)| b - a).collect()])
}

fn figure_3_2() -> Result<Reproduction> {
    let angles = record()?;
    let mut panel = Panel::new("", Axis::linear("lag dt / samples"), Axis::linear("I(dt) / bit"));
    let mut rows = Vec::new();
    for (c, x) in angles.iter().enumerate() {
        let bits = average_mutual_information(&Observable::angle(&[x], TAU / 1024.0, 1), 50, 64).bits;
        for (k, m) in minima(&bits).iter().take(3).enumerate() {
            let printed = if c == 0 { [5.0, 15.0, 18.0].get(k).copied() } else { None };
            rows.push(Row::new(format!("θ{}, minimum {}", c + 1, k + 1), "samples", printed, Some(m.lag as f64), None));
        }
        let lags = (1..=bits.len()).map(|i| i as f64).collect();
        panel.series.push(Series::new(format!("θ_{{{}}}", c + 1), Shape::Line, lags, bits));
    }
    Ok(made(
        "figure-3.2",
        "average mutual information of the two angles",
        rows,
        &["The seed sees weak minima at 5, 15, 18 and 24 and takes 24, near a quarter of the drive period."],
        (vec![panel], 1, 260.0),
    ))
}

fn figure_3_3() -> Result<Reproduction> {
    let [a, b] = record()?;
    let n = 40_000.min(a.len());
    let whirling = a.iter().filter(|x| super::drawing::wrapped(**x).abs() > 0.25 * TAU).count() as f64 / a.len() as f64;
    Ok(made(
        "figure-3.3",
        "phase portraits of the record, dt = 24",
        vec![Row::new("arm 1 beyond 90°", "% of the time", None, Some(100.0 * whirling), None)],
        &["As in the seed, arm 1 swings little with rare large turns, arm 2 mostly whirls."],
        (views(&a[..n], &b[..n]), 3, 240.0),
    ))
}

fn orbit(id: &str, period: usize, index: usize) -> Result<Reproduction> {
    let all = found_orbits(0.05)?;
    let o = orbit_of(&all, period, index)?;
    let [a, b] = angles(o);
    let n = o.len();
    let turned = |c: usize| ((o.phi[c][2 + n] - o.phi[c][2]) / TAU).round();
    // The orbit goes on after its end as it began.
    let closed = |x: &[f64]| -> Vec<f64> { x.iter().chain(&x[..DELAY.min(x.len())]).copied().collect() };
    Ok(made(
        id,
        &format!("an orbit of period {period}, dt = 24"),
        vec![
            Row::new("closing error", "% of the span", None, Some(100.0 * o.closing_error), None),
            Row::new("turns of arm 1", "", None, Some(turned(0)), None),
            Row::new("turns of arm 2", "", None, Some(turned(1)), None),
        ],
        &["Of the orbits of this period found here, one that closes best."],
        (views(&closed(&a), &closed(&b)), 3, 240.0),
    ))
}

fn figure_3_10() -> Result<Reproduction> {
    let data = data::table_3_9()?;
    let theta2: Vec<f64> = data.exact[1].iter().zip(&data.exact[0]).map(|(b, a)| b - a).collect();
    let n = 40_000.min(theta2.len());
    let whirling = data.exact[0].iter().filter(|x| super::drawing::wrapped(**x).abs() > 0.25 * TAU).count() as f64
        / data.exact[0].len() as f64;
    Ok(made(
        "figure-3.10",
        "phase portraits of the simulated system of Table 3.9, dt = 24",
        vec![Row::new("arm 1 beyond 90°", "% of the time", None, Some(100.0 * whirling), None)],
        &["The caption's C11 = 0.0366 is C12 = 0.00366. C11 is 0 here, as in Table 3.9."],
        (views(&data.exact[0][..n], &theta2[..n]), 3, 240.0),
    ))
}

/// The orbit of period 9 of figure 3.5.
fn nine() -> Result<Orbit> {
    let all = found_orbits(0.05)?;
    orbit_of(&all, 9, 0).cloned()
}

fn spectrum(x: &[f64], most: usize) -> (Vec<f64>, Vec<f64>) {
    let c = Fourier::new(&mut rustfft::FftPlanner::new(), x.len()).of_real(x);
    (1..most.min(x.len() / 2)).map(|j| (j as f64, (2.0 * c[j].norm()).max(1e-12))).unzip()
}

fn figure_3_11() -> Result<Reproduction> {
    let o = nine()?;
    let without = along(&o, false, Differentiation::Fourier);
    let with = along(&o, true, Differentiation::Fourier);
    let mut panels = Vec::new();
    let mut rows = Vec::new();
    for (i, name) in ["θ_{1}′", "θ_{1}″"].into_iter().enumerate() {
        let mut p = Panel::new("", Axis::linear("sub-harmonic k"), Axis::log(format!("amplitude of {name}")));
        for (label, x) in [("without", &without[i]), ("with low-pass at f_{s}/5", &with[i])] {
            let (k, a) = spectrum(x, 450);
            p.series.push(Series::new(label, Shape::Thin, k, a));
        }
        panels.push(p);
        let power = |x: &[f64]| (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
        rows.push(Row::new(
            format!("rms of {name} with / without low-pass"),
            "",
            None,
            Some(power(&with[i]) / power(&without[i])),
            None,
        ));
    }
    Ok(made(
        "figure-3.11",
        "spectra of velocity and acceleration of arm 1, orbit of period 9",
        rows,
        &[],
        (panels, 2, 240.0),
    ))
}

fn figure_3_12() -> Result<Reproduction> {
    let o = nine()?;
    let without = along(&o, false, Differentiation::Fourier);
    let with = along(&o, true, Differentiation::Fourier);
    let [v0, _, y0] = without;
    let [v1, _, y1] = with;
    let greatest = |x: &[f64]| x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let rows = vec![Row::new("largest |φ1′| without / with", "", None, Some(greatest(&v0) / greatest(&v1)), None)];
    let panels = vec![
        curve("(a) without filter", "θ_{1}′", v0),
        curve("(b) with filter", "θ_{1}′", v1),
        curve("(c) without filter", "y", y0),
        curve("(d) with filter", "y", y1),
    ];
    Ok(made(
        "figure-3.12",
        "velocity of arm 1 and y = φ2′² sin(φ2 − φ1), orbit of period 9",
        rows,
        &[],
        (panels, 2, 200.0),
    ))
}

fn figure_3_13() -> Result<Reproduction> {
    // The worst closing of those of period 9 at 8 % shows the jump best.
    let all = found_orbits(0.08)?;
    let count = all.iter().filter(|o| o.periods == 9).count();
    let o = orbit_of(&all, 9, count.saturating_sub(1))?;
    let [v0, a0, _] = along(o, true, Differentiation::Fourier);
    let [v1, a1, _] = along(o, true, Differentiation::FivePoint);
    let greatest = |x: &[f64]| x.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    let rows = vec![
        Row::new("largest |θ1″|, Fourier series", "", None, Some(greatest(&a0)), None),
        Row::new("largest |θ1″|, five points", "", None, Some(greatest(&a1)), None),
    ];
    let panels = vec![
        curve("(a) Fourier series", "θ_{1}′", v0),
        curve("(b) Fourier series", "θ_{1}″", a0),
        curve("(c) five points", "θ_{1}′", v1),
        curve("(d) five points", "θ_{1}″", a1),
    ];
    Ok(made(
        "figure-3.13",
        "an orbit of period 9 that closes to 8 % only: the jump is an impulse at its ends",
        rows,
        &[],
        (panels, 2, 200.0),
    ))
}

fn figure_3_14() -> Result<Reproduction> {
    let found = plain()?;
    let rows = error_rows(found, [Some(8.8), Some(18.4)]);
    let Orbits::Unstable { tolerance, .. } = seed_settings(0.05).orbits else { return figure_3_15() };
    let title = format!(
        "residuals of the second equation, orbits at {:.0} % of 1 to 16 periods of {PERIOD} samples",
        100.0 * tolerance
    );
    Ok(made("figure-3.14", &title, rows, &[], (vec![residuals("", found, 1)], 1, 280.0)))
}

fn figure_3_15() -> Result<Reproduction> {
    let found = optimised()?;
    let rows = error_rows(found, [Some(8.1), Some(9.4)]);
    let note = "Dropping what fits badly shrinks ε by definition: see Table 3.3 for orbits left out.";
    Ok(made("figure-3.15", "the same after the optimisation", rows, &[note], (vec![residuals("", found, 1)], 1, 280.0)))
}
