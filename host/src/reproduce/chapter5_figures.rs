//! Chapter 5's figures: phase portraits, shapes of the modes, the invariant manifold, time
//! histories, frequency against energy.

use std::f64::consts::TAU;

use super::chapter5::{Case, constraint_model, mass_pendulum, two_mass, type1, type2};
use super::chapter5_histories::{history_error, orbit, orbit_of, polar_history_error};
use super::{Item, Reproduction, Row};
use crate::error::Result;
use crate::reduce::added_constraint::{ConstraintModel, Function};
use crate::report::figures::axis::Axis;
use crate::report::figures::canvas::{Panel, Series, Shape};

/// Items of this file.
pub static ITEMS: &[Item] = &[
    Item {
        id: "figure-5.1",
        about: "two masses: phase portraits of full system and models, release 5",
        run: figure_5_1,
    },
    Item {
        id: "figure-5.2",
        about: "two masses: shapes of the first nonlinear normal mode",
        run: || shapes("figure-5.2", two_mass()?),
    },
    Item {
        id: "figure-5.3",
        about: "two masses: invariant manifold, fitted and by Shaw and Pierre's expansion",
        run: figure_5_3,
    },
    Item { id: "figure-5.4", about: "mass–pendulum: sketch", run: figure_5_4 },
    Item {
        id: "figure-5.5",
        about: "mass–pendulum: shapes of the first nonlinear normal mode",
        run: || shapes("figure-5.5", mass_pendulum()?),
    },
    Item {
        id: "figure-5.6",
        about: "mass–pendulum: model I against the full system, release 1",
        run: || against("figure-5.6", 0, type1()?),
    },
    Item { id: "figure-5.7", about: "mass–pendulum: model I, release 3", run: || against("figure-5.7", 2, type1()?) },
    Item { id: "figure-5.8", about: "mass–pendulum: model I, release 5", run: || against("figure-5.8", 4, type1()?) },
    Item {
        id: "figure-5.9", about: "mass–pendulum: model II, release 1", run: || against("figure-5.9", 0, type2()?)
    },
    Item {
        id: "figure-5.10",
        about: "mass–pendulum: model II, release 3",
        run: || against("figure-5.10", 2, type2()?),
    },
    Item {
        id: "figure-5.11",
        about: "mass–pendulum: model II, release 5",
        run: || against("figure-5.11", 4, type2()?),
    },
    Item {
        id: "figure-5.12",
        about: "mass–pendulum: time histories of full system and both models, release 3",
        run: figure_5_12,
    },
    Item {
        id: "figure-5.13",
        about: "mass–pendulum: frequency against energy, full system and models",
        run: figure_5_13,
    },
];

/// A block on a spring, displaced by x, with a bar of the same unit length hanging from it at θ:
/// (5.18), release 2 (x = 0.25, θ = 0.733).
fn figure_5_4() -> Result<Reproduction> {
    let (x, theta): (f64, f64) = (0.25, 0.733);
    let end = [x + theta.sin(), -theta.cos()];
    let along = |p: [f64; 2], q: [f64; 2]| -> (Vec<f64>, Vec<f64>) {
        (0..=20).map(|i| f64::from(i) / 20.0).map(|u| (p[0] + u * (q[0] - p[0]), p[1] + u * (q[1] - p[1]))).unzip()
    };
    // Around the block, half a bar wide.
    let (w, h) = (0.25, 0.12);
    let corners = [[-w, -h], [w, -h], [w, h], [-w, h], [-w, -h]].map(|c| [x + c[0], c[1]]);
    let (mut bx, mut by) = (Vec::new(), Vec::new());
    for c in corners.windows(2) {
        let (px, py) = along(c[0], c[1]);
        bx.extend(px);
        by.extend(py);
    }
    // Eight turns from the wall to the block.
    let (wall, turns) = (-1.2, 8.0);
    let (sx, sy): (Vec<f64>, Vec<f64>) = (0..=160)
        .map(|i| f64::from(i) / 160.0)
        .map(|u| (wall + u * (x - w - wall), 0.08 * (TAU * turns * u).sin()))
        .unzip();
    let mut panel = Panel::new(
        "",
        Axis::linear("x, bar lengths").range(-1.4, 1.4),
        Axis::linear("height, bar lengths").range(-1.1, 0.4),
    );
    let parts = [
        ("wall", along([wall, -0.3], [wall, 0.3]), 3),
        ("spring k", (sx, sy), 4),
        ("block m_{1}, displaced by x", (bx, by), 0),
        ("bar m_{2}, θ from hanging", along([x, 0.0], end), 1),
    ];
    for (name, (x, y), colour) in parts {
        panel.series.push(Series::new(name, Shape::Line, x, y).colour(colour));
    }
    Ok(Reproduction {
        id: "figure-5.4".into(),
        title: "sketch of the mass–pendulum system at rest in the second release".into(),
        rows: Vec::new(),
        notes: Vec::new(),
        panels: (vec![panel], 1, 320.0),
    })
}

fn line(name: &str, x: &[f64], y: &[f64], colour: usize) -> Series {
    Series::new(name, Shape::Line, x.to_vec(), y.to_vec()).colour(colour)
}

fn figure_5_1() -> Result<Reproduction> {
    let case = two_mass()?;
    let full = orbit(case, 4);
    // The seed's POD-only model is made from release 5 alone.
    let only = {
        let fits = [&case.fits[4]];
        let (orbits, unit) = crate::reduce::added_constraint::orbits(&fits, &case.pod.modes, false);
        let equation = [Function::power(1), Function::power(2), Function::power(3)];
        crate::reduce::added_constraint::fit(&orbits, &case.pod.modes, unit, &[], &equation)
    };
    let with = constraint_model(5)?;
    let mut panel = Panel::new("", Axis::linear("y_{2}"), Axis::linear("dy_{2}/dt"));
    let y0 = full[0][0];
    let mut rows = Vec::new();
    let truth = Some(case.members[4].omega);
    for (name, model, colour) in [("POD only", only.as_ref(), 0), ("with constraint", Some(&with), 1)] {
        if let Some([y, v, _]) = model.and_then(|m| orbit_of(m, y0)) {
            panel.series.push(line(name, &y, &v, colour));
        }
        let omega = model.and_then(|m| m.behaviour(y0)).map(|b| b.omega);
        rows.push(Row::new(format!("{name}: frequency, release 5"), "rad/s", None, omega, truth));
        let error = model.and_then(|m| history_error(case, m, 4));
        rows.push(
            Row::new(format!("{name}: error over ten periods"), "", None, error, Some(0.0))
                .ours(polar_history_error(case, 4)),
        );
    }
    // Dots, last: as a line it would lie under the constraint model's.
    let some = |x: &[f64]| x.iter().step_by(5).copied().collect();
    panel.series.push(Series::new("full system", Shape::BigDots, some(&full[0]), some(&full[1])).colour(5));
    Ok(Reproduction {
        id: "figure-5.1".into(),
        title: "Two masses, release 5: phase portraits of the full system, the POD-only and the constraint model.".into(),
        rows,
        notes: vec!["Release 5 is asymmetric: it lies on a branch with even harmonics (3 %), beyond the symmetric mode's loss of stability.".into()],
        panels: (vec![panel], 1, 320.0),
    })
}

fn shapes(id: &str, case: &Case) -> Result<Reproduction> {
    let mut panel = Panel::new("", Axis::linear("major coordinate"), Axis::linear("minor coordinate"));
    let mut rows = Vec::new();
    for i in 0..5 {
        let [y, _, z] = orbit(case, i);
        panel.series.push(line(&format!("release {}", i + 1), &y, &z, i));
        // The member's other point of rest is its mirror image, or its partner where it is
        // asymmetric.
        let truth = &case.members[i].rest;
        rows.push(Row::new(
            format!("release {}: rest x2/x1 of the mode at its energy", i + 1),
            "",
            Some(case.rest[i][1] / case.rest[i][0]),
            Some(case.fits[i].motion(1, 0.0)[0] / case.fits[i].motion(0, 0.0)[0]),
            Some(truth[1] / truth[0]),
        ));
    }
    Ok(Reproduction {
        id: id.into(),
        title: "Shapes of the first nonlinear normal mode at the five releases.".into(),
        rows,
        notes: vec![
            "Printed: the release itself; reproduced: the periodic motion fitted to its record; true: the normal mode at that energy by shooting \
             (of an asymmetric motion it may give the opposite end)."
                .into(),
        ],
        panels: (vec![panel], 1, 320.0),
    })
}

fn figure_5_3() -> Result<Reproduction> {
    let case = two_mass()?;
    // Shaw and Pierre's expansion of the in-phase mode, from (5.9): x2 = u + u³/3 + u u̇²/2, u =
    // x1.
    let asymptotic = |u: f64, v: f64| u + u.powi(3) / 3.0 + u * v * v / 2.0;
    let three = constraint_model(3)?;
    let five = constraint_model(5)?;
    let mut rows = Vec::new();
    let mut panels = Vec::new();
    for (title, model) in [("surface of releases 1–3", &three), ("surface of all five", &five)] {
        for i in 0..5 {
            let (mut e, mut a, mut s) = (0.0, 0.0, 0.0);
            for k in 0..160 {
                let phi = TAU * f64::from(k) / 160.0;
                let m = [case.fits[i].motion(0, phi), case.fits[i].motion(1, phi)];
                let dot = |mode: usize, d: usize| m[0][d] * case.pod.modes[mode][0] + m[1][d] * case.pod.modes[mode][1];
                let z = dot(1, 0);
                let x = model.displacement(dot(0, 0), dot(0, 1) / model.time_unit);
                let fitted = x[0] * case.pod.modes[1][0] + x[1] * case.pod.modes[1][1];
                e += (fitted - z).powi(2);
                a += (asymptotic(m[0][0], m[0][1]) - m[1][0]).powi(2);
                s += z * z;
            }
            let row = Row::new(
                format!("{title}: rms error of y1 over rms, release {}", i + 1),
                "",
                None,
                Some((e / s).sqrt()),
                Some(0.0),
            );
            rows.push(row);
            if title.ends_with("five") {
                let name = format!("Shaw–Pierre expansion: the same of x2, release {}", i + 1);
                rows.push(Row::new(name, "", None, Some((a / s).sqrt()), Some(0.0)));
            }
        }
        let mut panel = Panel::new(title, Axis::linear("y_{2}"), Axis::linear("y_{1}"));
        for i in if title.ends_with("five") { 0..5 } else { 0..3 } {
            let [y, v, z] = orbit(case, i);
            let fitted: Vec<f64> = y
                .iter()
                .zip(&v)
                .map(|(y, v)| {
                    let x = model.displacement(*y, v / model.time_unit);
                    x[0] * case.pod.modes[1][0] + x[1] * case.pod.modes[1][1]
                })
                .collect();
            panel.series.push(line(if i == 0 { "orbits" } else { "" }, &y, &z, 5));
            panel
                .series
                .push(Series::new(if i == 0 { "fitted surface" } else { "" }, Shape::Dots, y, fitted).colour(1));
        }
        panels.push(panel);
    }
    Ok(Reproduction {
        id: "figure-5.3".into(),
        title: "Two masses: the fitted constraint surface along the orbits.".into(),
        rows,
        notes: vec![
            "Shaw and Pierre's surface is the third-order expansion about rest; it leaves the orbits as they grow."
                .into(),
        ],
        panels: (panels, 2, 280.0),
    })
}

fn against(id: &str, release: usize, model: ConstraintModel) -> Result<Reproduction> {
    let case = mass_pendulum()?;
    let [y, v, z] = orbit(case, release);
    let mut phase = Panel::new("phase plane", Axis::linear("z_{1}"), Axis::linear("dz_{1}/dt / (1/s)"));
    let mut shape = Panel::new("shape of the mode", Axis::linear("z_{1}"), Axis::linear("z_{2}"));
    phase.series.push(line("full system", &y, &v, 5));
    shape.series.push(line("full system", &y, &z, 5));
    if let Some([a, b, c]) = orbit_of(&model, y[0]) {
        phase.series.push(line("model", &a, &b, 1));
        shape.series.push(line("model", &a, &c, 1));
    }
    let behaviour = model.behaviour(y[0]);
    Ok(Reproduction {
        id: id.into(),
        title: format!(
            "Mass–pendulum, release {}: model {} against the full system.",
            release + 1,
            if model.equation.len() > 2 { "II" } else { "I" }
        ),
        rows: vec![
            Row::new("frequency", "rad/s", None, behaviour.map(|b| b.omega), Some(case.members[release].omega)),
            Row::new("change of amplitude over ten periods", "", None, behaviour.map(|b| b.drift), Some(0.0)),
            Row::new("error over ten periods", "", None, history_error(case, &model, release), Some(0.0))
                .ours(polar_history_error(case, release)),
        ],
        notes: Vec::new(),
        panels: (vec![phase, shape], 2, 280.0),
    })
}

fn figure_5_12() -> Result<Reproduction> {
    let case = mass_pendulum()?;
    let x = &case.records[2];
    let count = (6.0 * TAU / case.fits[2].omega / case.step) as usize;
    let t: Vec<f64> = (0..count).map(|i| i as f64 * case.step).collect();
    let project = |a: f64, b: f64| a * case.pod.modes[0][0] + b * case.pod.modes[0][1];
    let y: Vec<f64> = (0..count).map(|i| project(x[0][i], x[1][i])).collect();
    let mut panel = Panel::new("", Axis::linear("t / s"), Axis::linear("z_{1}"));
    panel.series.push(line("full system", &t, &y, 5));
    let mut rows = Vec::new();
    for (name, model, colour) in [("model I", type1()?, 0), ("model II", type2()?, 1)] {
        let states: Vec<f64> = model.simulate(y[0], case.step, count).iter().map(|s| s[0]).collect();
        panel.series.push(line(name, &t[..states.len()], &states, colour));
        rows.push(
            Row::new(format!("{name}: error over ten periods"), "", None, history_error(case, &model, 2), Some(0.0))
                .ours(polar_history_error(case, 2)),
        );
    }
    Ok(Reproduction {
        id: "figure-5.12".into(),
        title: "Mass–pendulum, release 3: time histories.".into(),
        rows,
        notes: Vec::new(),
        panels: (vec![panel], 1, 220.0),
    })
}

fn figure_5_13() -> Result<Reproduction> {
    let case = mass_pendulum()?;
    let (one, two) = (type1()?, type2()?);
    let (first, last) = (case.members[0].energy, case.members[4].energy);
    let energies: Vec<f64> = (0..=24).map(|i| first + (last - first) * f64::from(i) / 24.0).collect();
    let members = crate::reduce::normal_mode::family(&*case.system, &energies);
    let mut panel = Panel::new("", Axis::linear("energy / (m_{2}l² per s²)"), Axis::linear("frequency / (rad/s)"));
    let (e, w): (Vec<f64>, Vec<f64>) = members.iter().map(|m| (m.energy, m.omega)).unzip();
    panel.series.push(line("full system", &e, &w, 5));
    for (name, model, colour) in [("model I", &one, 0), ("model II", &two, 1)] {
        let (e, w): (Vec<f64>, Vec<f64>) =
            energies.iter().filter_map(|e| case.omega_at(model, *e).map(|w| (*e, w))).unzip();
        panel.series.push(line(name, &e, &w, colour));
    }
    let polar = |energy: f64| -> Option<f64> {
        let a = case.known.amplitude_at(&*case.system, energy)?;
        case.known.corrected_omega(&*case.system, &case.all, a)
    };
    let (e, w): (Vec<f64>, Vec<f64>) = energies.iter().filter_map(|e| polar(*e).map(|w| (*e, w))).unzip();
    panel.series.push(Series::new("polar model", Shape::BigDots, e, w).colour(2));
    let mut rows = Vec::new();
    for (name, model) in [("model I", &one), ("model II", &two)] {
        for (i, m) in case.members.iter().enumerate() {
            let row = Row::new(
                format!("{name}, release {}", i + 1),
                "rad/s",
                None,
                case.omega_at(model, m.energy),
                Some(m.omega),
            );
            rows.push(row.ours(polar(m.energy)));
        }
    }
    Ok(Reproduction {
        id: "figure-5.13".into(),
        title: "Mass–pendulum: frequency against energy at rest. The full system hardens; model I softens.".into(),
        rows,
        notes: vec!["The seed prints a graph only: full system hardening, model I softening, model II between.".into()],
        panels: (vec![panel], 1, 320.0),
    })
}

#[cfg(test)]
#[path = "chapter5_figures_tests.rs"]
mod tests;
