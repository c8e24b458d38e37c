//! The battery of hidden effects: every effect that the simulator has, at three strengths, two
//! resolutions, two lengths and several seeds, and records in which nothing is hidden. Each is
//! explained, and what was said is compared with what was hidden.

use std::path::Path;

use whirl::explain::{Explanation, Settings, Verdict, explain};
use whirl::record::Record;
use whirl::record::formats::ReadOptions;
use whirl::rig::Rig;

/// Effects and a strength of each that shows clearly in 120 s at 4096 counts.
pub const HIDDEN: &[(&str, f64, &str)] = &[
    ("viscous-friction@joint1", 1e-5, ""),
    ("coulomb-friction@joint2", 2e-5, ""),
    ("stribeck-friction@joint1", 2e-4, ",v_s=1"),
    ("stribeck-friction@joint2", 5e-5, ",v_s=3"),
    ("load-dependent-friction@joint2", 1e-5, ""),
    ("quadratic-drag@arm1", 5e-6, ""),
    ("quadratic-drag@arm2", 5e-8, ""),
    ("asymmetric-friction@joint1", 1e-4, ""),
    ("asymmetric-friction@joint2", 2e-5, ""),
    ("torsion-spring@joint1", 2e-3, ""),
    ("torsion-spring@joint2", 2e-5, ""),
    ("cubic-stiffness@joint1", 1e-3, ""),
    ("cubic-stiffness@joint2", 1e-5, ""),
    ("quadratic-stiffness@joint1", 1e-3, ""),
    ("quadratic-stiffness@joint2", 1e-5, ""),
    ("backlash@joint2", 0.5, ",k=1e-4"),
    ("cogging@joint1", 2e-4, ",n=12"),
    ("cogging@joint2", 3e-5, ",n=8"),
    ("amplitude-dependent-damping@joint1", 1e-4, ""),
    ("amplitude-dependent-damping@joint2", 2e-6, ""),
    ("imbalance@arm1", 0.01, ""),
    ("imbalance@arm2", 0.005, ""),
    ("constant-force@joint1", 1e-4, ""),
    ("constant-force@joint2", 1e-5, ""),
    ("frame-tilt@frame", 0.005, ""),
    ("horizontal-motion@drive", 2e-4, ""),
    ("drive-harmonic-2@drive", 0.01, ""),
    ("drive-harmonic-3@drive", 0.005, ""),
    ("amplitude-drift@drive", 0.01, ""),
    ("frequency-offset@drive", 1e-4, ""),
    ("zero-offset@encoder1", 0.005, ""),
    ("zero-offset@encoder2", 0.005, ""),
    ("scale-error@encoder1", 1e-3, ""),
    ("scale-error@encoder2", 1e-4, ""),
    ("eccentricity@encoder1", 0.005, ""),
    ("eccentricity@encoder2", 0.005, ""),
    ("channel-delay@encoder2", 2e-4, ""),
];

/// Pairs that are hidden together.
pub const PAIRS: &[[&str; 2]] = &[
    ["quadratic-drag@arm2=2e-7", "coulomb-friction@joint2=3e-5"],
    ["torsion-spring@joint2=3e-5", "zero-offset@encoder1=0.005"],
    ["eccentricity@encoder2=0.005", "viscous-friction@joint1=2e-5"],
    ["drive-harmonic-2@drive=0.01", "cogging@joint2=5e-5,n=8"],
    ["frame-tilt@frame=0.005", "quadratic-drag@arm1=1e-5"],
    ["channel-delay@encoder2=2e-4", "stribeck-friction@joint1=3e-4,v_s=1"],
    // The second of these two shows at 1024 counts too.
    ["eccentricity@encoder2=0.005", "viscous-friction@joint1=1e-4"],
    ["channel-delay@encoder2=2e-4", "stribeck-friction@joint1=1e-3,v_s=1"],
];

/// Shapes that no single effect of the list has.
pub const NAMELESS: &[&[&str]] = &[
    &["cogging@joint2=1e-4,n=3", "cogging@joint2=1e-4,n=5", "cogging@joint2=1e-4,n=7"],
    &["cogging@joint1=1e-3,n=4", "cogging@joint1=1e-3,n=7", "cogging@joint1=1e-3,n=11"],
];

/// Rig of a record.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    /// `rigs/chaotic.toml`, 5 Hz.
    #[default]
    Driven,
    /// The same at 5.2 Hz: a period is no whole number of samples.
    Driven52,
    /// The same without a drive and with a tenth of the friction, let go with arm 1 near the top.
    Free,
}

impl Kind {
    /// The rig file's text at a resolution.
    fn text(self, chaotic: &str, counts: u32) -> String {
        let text = chaotic.replace("counts_per_turn = 4096", &format!("counts_per_turn = {counts}"));
        let line = |l: &str| match (self, l.split_whitespace().next().unwrap_or("")) {
            (Self::Driven, _) => l.to_owned(),
            (Self::Driven52, "frequency_hz") => "frequency_hz = 5.2".to_owned(),
            (Self::Free, "[drive]" | "direction" | "frequency_hz") => String::new(),
            (Self::Free, "amplitude_m") => "amplitude_m = 0.0".to_owned(),
            (Self::Free, "settle_s") => "settle_s = 0.0".to_owned(),
            (Self::Free, "initial") => "initial = [2.5, 2.0, 0.0, 0.0]".to_owned(),
            (Self::Free, "tau_c1") => "tau_c1 = 6.03e-5".to_owned(),
            (Self::Free, "c_r2") => "c_r2 = 6.145e-6".to_owned(),
            _ => l.to_owned(),
        };
        text.lines().map(|l| line(l) + "\n").collect()
    }
}

/// One record of the battery.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Rig.
    pub kind: Kind,
    /// `ID@PLACE=VALUE…` of what is hidden; empty for nothing.
    pub effects: Vec<String>,
    /// Counts a turn.
    pub counts: u32,
    /// Length, s.
    pub seconds: u32,
    /// Seed.
    pub seed: u64,
}

impl Case {
    /// A name that tells it from all others.
    pub fn name(&self) -> String {
        let kind = match self.kind {
            Kind::Driven => "",
            Kind::Driven52 => " | 5.2 Hz",
            Kind::Free => " | free",
        };
        format!("{} | {} | {} | {}{kind}", self.effects.join(" + "), self.counts, self.seconds, self.seed)
    }

    /// `ID@PLACE` of each hidden effect.
    pub fn truth(&self) -> Vec<&str> {
        self.effects.iter().filter_map(|e| e.split('=').next()).collect()
    }

    /// Simulates the record and explains it.
    ///
    /// # Panics
    /// Where a record cannot be simulated, written or read: the battery is a test.
    pub fn explain(&self) -> Explanation {
        self.explained_by("chaotic.toml")
    }

    /// Simulates the record by `rigs/chaotic.toml` and explains it by another file of that folder,
    /// which states the same rig (its equations as a model file, for example).
    ///
    /// # Panics
    /// As [`Self::explain`].
    pub fn explained_by(&self, file: &str) -> Explanation {
        let stated = self.rig(file);
        let rig = self.rig("chaotic.toml");
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("record.parquet");
        let quiet = indicatif::ProgressBar::hidden();
        whirl::simulate::record(&rig, &self.effects, f64::from(self.seconds), self.seed, &file, &quiet).unwrap();
        let record = Record::read(&file, &stated, &ReadOptions::default()).unwrap();
        explain(&[record], &stated, &Settings::default()).unwrap()
    }

    /// A rig file with this case's resolution and drive.
    fn rig(&self, file: &str) -> Rig {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(file);
        Rig::parse(&self.kind.text(&std::fs::read_to_string(&path).unwrap(), self.counts), &path).unwrap()
    }
}

/// Every effect at a third, once and three times its strength, at 4096 and 1024 counts, 120 and 60
/// s, as many records with nothing hidden as effects, and others with nothing hidden: longer ones,
/// at 5.2 Hz, free.
pub fn cases(seeds: core::ops::RangeInclusive<u64>) -> Vec<Case> {
    let mut out = Vec::new();
    for seed in seeds {
        for (counts, seconds) in [(4096, 120), (1024, 120), (1024, 60)] {
            for (number, (name, strength, rest)) in (0_u64..).zip(HIDDEN) {
                for factor in [1.0 / 3.0, 1.0, 3.0] {
                    // The dead zone's half width stays: its stiffness is what makes it strong.
                    let effect = if name.starts_with("backlash") {
                        format!("{name}={strength},k={:e}", factor * 1e-4)
                    } else {
                        format!("{name}={:e}{rest}", factor * strength)
                    };
                    out.push(Case {
                        kind: Kind::Driven,
                        effects: vec![effect],
                        counts,
                        seconds,
                        seed: 100 * seed + number,
                    });
                }
                out.push(Case {
                    kind: Kind::Driven,
                    effects: Vec::new(),
                    counts,
                    seconds,
                    seed: 100 * seed + 50 + number,
                });
            }
            for hidden in PAIRS.iter().map(|p| &p[..]).chain(NAMELESS.iter().copied()) {
                let effects = hidden.iter().map(|e| (*e).to_owned()).collect();
                out.push(Case { kind: Kind::Driven, effects, counts, seconds, seed: 100 * seed + 90 });
            }
        }
        // Nothing hidden, on other rigs and over longer records.
        for counts in [4096, 1024] {
            let others =
                [(Kind::Driven, 300), (Kind::Driven52, 60), (Kind::Driven52, 120), (Kind::Free, 60), (Kind::Free, 120)];
            for (number, (kind, seconds)) in (0_u64..).zip(others) {
                for repeat in 0..4 {
                    let seed = 100 * seed + 60 + 4 * number + repeat;
                    out.push(Case { kind, effects: Vec::new(), counts, seconds, seed });
                }
            }
        }
    }
    out
}

/// What was said of a case, as a line of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Said {
    /// Verdict.
    pub verdict: Verdict,
    /// Effects named, in order.
    pub named: Vec<String>,
    /// What the first is not told apart from.
    pub twins: Vec<String>,
    /// Gap before and after.
    pub gap: [f64; 2],
    /// Held-out gain of the first hidden effect over its standard error, in the first step.
    pub deviations: f64,
    /// (Value found − value hidden)/standard error, where the first effect was named rightly and
    /// its scale is known.
    pub error_sigmas: f64,
}

impl Said {
    /// Reads an explanation.
    pub fn of(case: &Case, e: &Explanation) -> Self {
        let truth = case.truth();
        let ranked = e.ranking.iter().find(|r| r.step == 0 && truth.first().is_some_and(|t| r.name == **t));
        let value: Option<f64> = case.effects.first().and_then(|t| {
            let (_, rest) = t.split_once('=')?;
            rest.split(',').next()?.parse().ok()
        });
        let first = e.effects.first();
        let right = first.filter(|f| truth.first().is_some_and(|t| format!("{}@{}", f.id, f.at) == **t));
        Self {
            verdict: e.verdict,
            named: e.effects.iter().map(|f| format!("{}@{}", f.id, f.at)).collect(),
            twins: first.map_or_else(Vec::new, |f| f.indistinguishable_from.clone()),
            gap: [e.gap.steps.first(), e.gap.steps.last()].map(|s| s.map_or(f64::NAN, |s| s.value)),
            deviations: ranked.map_or(0.0, |r| r.deviations),
            error_sigmas: right
                .zip(value)
                .map_or(f64::NAN, |(f, v)| (f.value.abs() - v.abs()) / f.std_error.max(f64::MIN_POSITIVE)),
        }
    }
}
