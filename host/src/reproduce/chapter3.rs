//! Chapter 3's tables: the double pendulum. The seed's experiment is replaced by the simulated rig
//! with the printed parameters at 1.35 times the printed amplitude (with the printed one it is not
//! chaotic for good), 1024 counts, 670 000 samples.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use whirl_hil_sim::Parameters;

use super::chapter3_frequencies::table_3_10;
use super::chapter3_orbits::table_3_5;
use super::data::{self, Data};
use super::{Item, Reproduction, Row};
use crate::error::Result;
use crate::identify::Identification;
use crate::identify::harmonic_balance::settings::{Differentiation, EnergyBalance, Orbits, Settings};

/// Items of this file.
pub static ITEMS: &[Item] = &[
    Item { id: "table-3.1", about: "double pendulum: physical properties, and what follows from them", run: table_3_1 },
    Item { id: "table-3.2", about: "double pendulum: experimental settings", run: table_3_2 },
    Item { id: "table-3.3", about: "double pendulum: orbits, filter, optimisation", run: table_3_3 },
    Item { id: "table-3.4", about: "double pendulum: the same with known friction", run: table_3_4 },
    Item { id: "table-3.5", about: "double pendulum: Fourier coefficients with and without filter", run: table_3_5 },
    Item { id: "table-3.6", about: "double pendulum: no filter", run: table_3_6 },
    Item {
        id: "table-3.7",
        about: "double pendulum: tolerance 8 %, Fourier series and digital differentiation",
        run: table_3_7,
    },
    Item { id: "table-3.8", about: "double pendulum: not optimised", run: table_3_8 },
    Item { id: "table-3.9", about: "double pendulum: identified from a simulated system", run: table_3_9 },
    Item { id: "table-3.10", about: "double pendulum: natural frequencies", run: table_3_10 },
    Item { id: "table-3.11", about: "double pendulum: dampings by energy balance", run: table_3_11 },
];

/// T_d of the seed, samples.
pub(super) const DELAY: usize = 24;
/// Samples a drive period.
pub(super) const PERIOD: f64 = 100.0;

/// Extraction at a tolerance.
pub(super) fn extraction(tolerance: f64) -> Orbits {
    Orbits::Unstable { tolerance, longest: 16, delay: Some(DELAY) }
}

/// The seed's choices at a tolerance.
pub(super) fn settings(tolerance: f64) -> Settings {
    Settings { orbits: extraction(tolerance), ..Settings::orbits(tolerance) }
}

pub(super) fn kept(
    cell: &'static OnceLock<Result<Identification>>,
    make: fn() -> Result<Identification>,
) -> Result<&'static Identification> {
    cell.get_or_init(make).as_ref().map_err(Clone::clone)
}

/// The weak form of the seed's record.
pub(super) fn weak() -> Result<&'static Identification> {
    static FOUND: OnceLock<Result<Identification>> = OnceLock::new();
    kept(&FOUND, || data::double()?.weak())
}

/// Table 3.3's identification.
pub(super) fn optimised() -> Result<&'static Identification> {
    static FOUND: OnceLock<Result<Identification>> = OnceLock::new();
    kept(&FOUND, || data::double()?.balance(&settings(0.05)))
}

/// Table 3.8's: the same without optimisation.
pub(super) fn plain() -> Result<&'static Identification> {
    static FOUND: OnceLock<Result<Identification>> = OnceLock::new();
    kept(&FOUND, || data::double()?.balance(&Settings { optimisation: None, ..settings(0.05) }))
}

pub(super) fn value(found: &Identification, name: &str) -> Option<f64> {
    found.parameter(name).map(|p| p.value)
}

/// Rows of coefficients: name and printed value.
pub(super) fn rows(
    printed: &[(&str, Option<f64>)],
    found: &Identification,
    data: &Data,
    best: &Identification,
) -> Vec<Row> {
    let unit = |name: &str| match name {
        "J_o1" | "J_o2" => "kg m²",
        "a" => "m",
        "m1e1" => "kg m",
        _ => "",
    };
    printed
        .iter()
        .map(|(name, printed)| {
            Row::new(*name, unit(name), *printed, value(found, name), data.truth(name)).ours(value(best, name))
        })
        .collect()
}

/// Row of an equation's ε.
pub(super) fn error_rows(found: &Identification, printed: [Option<f64>; 2]) -> Vec<Row> {
    found
        .identification_error
        .iter()
        .zip(printed)
        .enumerate()
        .map(|(e, (error, printed))| Row::new(format!("ε{}", e + 1), "%", printed, Some(100.0 * error), None))
        .collect()
}

fn count_rows(found: &Identification, orbits: Option<f64>) -> Vec<Row> {
    let n = found.balance.as_ref().map_or(0, |b| b.orbits.len());
    vec![
        Row::new("distinct orbits", "", orbits, Some(n as f64), None),
        Row::new("rows used", "", None, Some(found.equations_used as f64), None),
        Row::new("rows dropped", "", None, Some(found.equations_dropped as f64), None),
    ]
}

const AMPLITUDE: &str = "The printed values belong to the experiment at 1.15 cm, the others to the simulated rig at 1.5525 cm: B15 and B25 are \
                         1.35 times as large.";
const ORBITS: &str =
    "This rig recurs far more often than the experiment, which gave six orbits at 5 %: most are of short periods.";

pub(super) fn table(id: &str, title: &str, rows: Vec<Row>, notes: &[&str]) -> Reproduction {
    Reproduction {
        id: id.into(),
        title: title.into(),
        rows,
        notes: notes.iter().map(|n| (*n).to_owned()).collect(),
        panels: Default::default(),
    }
}

fn table_3_1() -> Result<Reproduction> {
    let data = data::double()?;
    let p = Parameters::PRINTED;
    let set = |name: &str, unit, v: f64| Row::new(name, unit, Some(v), Some(v), Some(v));
    let second = (TAU * 5.0_f64).powi(2);
    let follows = |name: &str, printed: f64, v: f64| Row::new(name, "", Some(printed), Some(v), None);
    let a = 0.0115;
    Ok(table(
        "table-3.1",
        "physical properties, and the coefficients that follow from them at the printed 1.15 cm",
        vec![
            set("m1", "kg", p.m1),
            set("e1", "m", p.e1),
            set("l1", "m", p.l1),
            Row::new("J_o1", "kg m²", Some(5.99e-4), Some(p.j_o1), data.truth("J_o1")),
            set("m2", "kg", p.m2),
            set("e2", "m", p.e2),
            Row::new("J_o2", "kg m²", Some(4.033e-5), Some(p.j_o2), data.truth("J_o2")),
            follows("B11", 0.1131, p.h() / p.j_o1),
            follows("B12", 0.0711, p.g * p.s1() / (p.j_o1 * second)),
            follows("B15", 0.0820, a * p.s1() / p.j_o1),
            follows("B21", 1.6816, p.h() / p.j_o2),
            follows("B22", 0.2630, p.g * p.s2() / (p.j_o2 * second)),
            follows("B25", 0.2913, a * p.s2() / p.j_o2),
            follows("C12 from C2 0.0485", 0.00366, 0.0485 * p.j_o2 / p.j_o1),
            Row::new("m1 e1", "kg m", Some(1.60e-3), Some(p.m1 * p.e1), data.truth("m1e1")),
        ],
        &[
            "Three printed “true” values do not follow from the table: B25 0.2913 (0.3045), C12 0.00366 (0.00327), m1 e1 1.60e-3 (1.730e-3).",
        ],
    ))
}

fn table_3_2() -> Result<Reproduction> {
    let data = data::double()?;
    let samples = data.records.first().map_or(0, |r| r.samples()) as f64;
    Ok(table(
        "table-3.2",
        "settings of the experiment and of the simulated rig",
        vec![
            Row::new("sampling rate", "Hz", Some(500.0), Some(data.rig.sample_rate_hz), None),
            Row::new("excitation frequency", "Hz", Some(5.0), data.rig.drive.map(|d| d.frequency_hz), None),
            Row::new("excitation amplitude", "m", Some(0.0115), data.truth("a"), None),
            Row::new("samples", "", Some(670_000.0), Some(samples), None),
            Row::new("counts a turn", "", Some(1024.0), data.rig.channel[0].counts_per_turn.map(f64::from), None),
        ],
        &[
            "At the printed amplitude the simulated rig locks (arm 2 turns once a period); at 1.35 times it is chaotic for good, with a largest \
             exponent of about 0.79 a drive period.",
        ],
    ))
}

const TABLE_3_3: [(&str, Option<f64>); 13] = [
    ("B11", Some(0.1167)),
    ("B12", Some(0.0781)),
    ("B15", Some(0.0849)),
    ("B21", Some(1.6149)),
    ("B22", Some(0.2562)),
    ("B25", Some(0.2868)),
    ("C11", Some(0.0001)),
    ("C12", Some(0.0007)),
    ("C2", Some(0.0106)),
    ("J_o1", Some(5.8113e-4)),
    ("J_o2", Some(4.1995e-5)),
    ("a", Some(0.0118)),
    ("m1e1", Some(1.73e-3)),
];

fn table_3_3() -> Result<Reproduction> {
    let (data, found) = (data::double()?, optimised()?);
    let mut all = rows(&TABLE_3_3, found, data, weak()?);
    all.extend(error_rows(found, [Some(8.1), Some(9.4)]));
    all.extend(count_rows(found, Some(6.0)));
    let held: Vec<String> = found
        .balance
        .iter()
        .flat_map(|b| b.equations.iter().enumerate())
        .filter_map(|(e, q)| {
            let h = q.held_out?;
            let (plain, kept) = (100.0 * h.plain[0], 100.0 * h.optimised[0]);
            Some(format!("equation {}: {plain:.1} % from all rows, {kept:.1} % from those kept", e + 1))
        })
        .collect();
    let mut r =
        table("table-3.3", "orbits at 5 %, low-pass, sub-harmonics up to f_e, optimised", all, &[AMPLITUDE, ORBITS]);
    r.notes.push(format!(
        "On orbits left out, where nothing may be dropped, ε is — {}: the optimisation flatters itself.",
        held.join("; ")
    ));
    r.notes.push(
        "By the ties the printed values give a = 1.08 and 1.11 cm, not 1.18, and m1 e1 = 2.03e-3, not 1.73e-3.".into(),
    );
    Ok(r)
}

fn table_3_4() -> Result<Reproduction> {
    let data = data::double()?;
    let known = ["C11", "C12", "C2"].iter().filter_map(|n| Some(((*n).to_owned(), data.truth(n)?))).collect();
    let found = data.balance(&Settings { known, ..settings(0.05) })?;
    let printed =
        [("B11", 0.1178), ("B12", 0.0774), ("B15", 0.0852), ("B21", 1.6040), ("B22", 0.2646), ("B25", 0.2880)];
    let printed = printed.map(|(n, v)| (n, Some(v)));
    Ok(table(
        "table-3.4",
        "the same with C11, C12, C2 known",
        rows(&printed, &found, data, weak()?),
        &["As in the seed, small dampings hardly matter to the other coefficients.", AMPLITUDE],
    ))
}

fn table_3_6() -> Result<Reproduction> {
    let data = data::double()?;
    let found = data.balance(&Settings { low_pass: None, ..settings(0.05) })?;
    let printed = [
        ("B11", 0.1125),
        ("B12", 0.0790),
        ("B15", 0.0825),
        ("B21", 1.1611),
        ("B22", 0.2553),
        ("B25", 0.2564),
        ("C11", 0.0003),
        ("C12", -0.0002),
        ("C2", 0.0164),
    ];
    let mut all = rows(&printed.map(|(n, v)| (n, Some(v))), &found, data, weak()?);
    all.extend(error_rows(&found, [None, None]));
    Ok(table("table-3.6", "the same orbits without low-pass", all, &[AMPLITUDE, "B21 suffers most, as in the seed."]))
}

/// Table 3.7's two identifications.
fn table_3_7() -> Result<Reproduction> {
    let data = data::double()?;
    let series = data.balance(&settings(0.08))?;
    let digital = data.balance(&Settings { differentiation: Differentiation::FivePoint, ..settings(0.08) })?;
    let printed = [
        ("B11", 0.0126, 0.1224),
        ("B12", 0.0730, 0.0760),
        ("B15", 0.0908, 0.0908),
        ("B21", 1.4703, 1.6103),
        ("B22", 0.2607, 0.2559),
        ("B25", 0.2851, 0.2772),
        ("C11", 0.0014, -0.0003),
        ("C12", 0.0005, 0.0016),
        ("C2", 0.0053, 0.0093),
    ];
    let mut all = Vec::new();
    for (name, fs, dd) in printed {
        for (how, printed, found) in [("Fourier series", fs, &series), ("digital differentiation", dd, &digital)] {
            let row = Row::new(format!("{name}, {how}"), "", Some(printed), value(found, name), data.truth(name));
            all.push(row.ours(value(weak()?, name)));
        }
    }
    all.extend(count_rows(&series, Some(58.0)));
    Ok(table(
        "table-3.7",
        "orbits at 8 %: Fourier series against five-point differentiation",
        all,
        &[
            "Five points do not see the jump where an orbit fails to close; the Fourier series turns it into an impulse.",
            AMPLITUDE,
        ],
    ))
}

fn table_3_8() -> Result<Reproduction> {
    let (data, found) = (data::double()?, plain()?);
    let printed = [
        ("B11", 0.1178),
        ("B12", 0.0782),
        ("B15", 0.0861),
        ("B21", 1.4935),
        ("B22", 0.2562),
        ("B25", 0.2828),
        ("C11", 0.0001),
        ("C12", 0.0007),
        ("C2", 0.0147),
    ];
    let mut all = rows(&printed.map(|(n, v)| (n, Some(v))), found, data, weak()?);
    all.extend(error_rows(found, [Some(8.8), Some(18.4)]));
    Ok(table("table-3.8", "as Table 3.3, but with all sub-harmonics", all, &[AMPLITUDE]))
}

fn table_3_9() -> Result<Reproduction> {
    let data = data::table_3_9()?;
    // The seed extracts at 5 %; 2 % is what it says the Fourier series needs.
    let found = data.balance(&settings(0.02))?;
    let best = data.weak()?;
    let printed = [
        ("J_o1", 5.767e-4),
        ("J_o2", 4.310e-5),
        ("B11", 0.1166),
        ("B12", 0.0787),
        ("B15", 0.0848),
        ("C11", 0.0005),
        ("C12", 0.0038),
        ("B21", 1.5943),
        ("B22", 0.2568),
        ("B25", 0.2866),
        ("C2", 0.0429),
    ];
    let mut all = rows(&printed.map(|(n, v)| (n, Some(v))), &found, data, &best);
    all.extend(error_rows(&found, [None, None]));
    all.extend(count_rows(&found, None));
    Ok(table(
        "table-3.9",
        "identified from the simulated system",
        all,
        &[
            "The printed setting breaks the tie B12/B15 = B22/B25, which no plant can: B12 is 0.0758 here instead of 0.0781. Orbits at 2 %.",
        ],
    ))
}

fn table_3_11() -> Result<Reproduction> {
    let data = data::double()?;
    let seed = data.balance(&Settings { energy_balance: EnergyBalance::Equations, ..settings(0.05) })?;
    let coupled = data.balance(&Settings {
        energy_balance: EnergyBalance::Coupled,
        differentiation: Differentiation::FivePoint,
        optimisation: None,
        ..Settings::frequency(100)
    })?;
    let mut all = rows(&[("C11", Some(-0.0004)), ("C12", Some(0.0045)), ("C2", Some(0.0396))], &seed, data, weak()?);
    for name in ["C11", "C12", "C2"] {
        let label = format!("{name}, both equations together, pieces by five points");
        all.push(Row::new(label, "", None, value(&coupled, name), data.truth(name)));
    }
    let tie = |f: &Identification| Some(value(f, "C12")? / value(f, "C2")?);
    let truth = Some(data.truth("C12").unwrap_or(0.0) / data.truth("C2").unwrap_or(1.0));
    all.push(Row::new("C12/C2 (tie: J_o2/J_o1)", "", Some(0.0045 / 0.0396), tie(&seed), truth));
    Ok(table(
        "table-3.11",
        "dampings by the energy balance, each equation by itself as in the seed",
        all,
        &[
            "The printed true C11, 0.000101, stands for 1.01e-3. Equation by equation the coupling, moved to the right, is as large as the drive's work.",
        ],
    ))
}

#[cfg(test)]
#[path = "chapter3_tests.rs"]
mod tests;
