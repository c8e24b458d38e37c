//! From a record to the coefficients of the equations of motion, with standard errors.
//!
//! From the measured angles alone: the weak form (method: [`windows`], least squares and covariance: [`regression`]) gives the start, and by default
//! multiple shooting ([`shooting`]) the answer wherever it stands ([`best`]). Physical parameters follow where quantities are known ([`physical_parameters`]).

mod assembly;
pub mod best;
pub mod boots;
pub mod card;
pub mod chain_bias;
pub mod energy_balance;
mod free_geometry;
pub mod from_rows;
pub mod general;
mod geometry;
pub mod harmonic_balance;
pub mod identifiability;
pub mod instruments;
pub mod judgement;
pub mod known_quantities;
pub mod model_file;
pub mod noise_bias;
pub mod physical_parameters;
pub mod presentation;
pub mod regression;
pub mod shooting;
pub mod single_parameters;
mod standstill;
pub mod suspects;
pub mod system;
mod transforms;
pub mod windows;

use core::f64::consts::TAU;
use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use crate::error::{BadInput, Result};
use crate::model::double_pendulum::{DAMPINGS, DEFAULT_DAMPINGS, Damping};
use crate::record::Record;
use crate::rig::Rig;
use crate::signal::angles::AngleSegment;
use crate::signal::noise;
use crate::warning::Warning;

use regression::Unsolvable;
use system::System;
use windows::{Kernels, Windows};

/// Methods of identification: name, what it does.
pub const METHODS: &[(&str, &str)] = &[
    (
        "weak",
        "weak form: sin⁴ windows over 20 drive periods (4 s when free), integrated by parts; least squares per equation",
    ),
    (
        "shooting",
        "multiple-shooting maximum likelihood from the weak form's start: pieces of 1, 2 and 4 drive periods, quantisation as noise",
    ),
    ("frequency", "harmonic balance of long pieces of n drive periods, closed or not"),
    ("upo", "harmonic balance of extracted unstable periodic orbits"),
];

/// Choices of the weak form. `None`: chosen from the record, as each says.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Settings {
    /// Length of a window, s; by default 20 drive periods, or 4 s for a free system.
    pub window_s: Option<f64>,
    /// Highest frequency of the test functions, Hz; by default 2 f_e, or for a free system the frequency below which lie 99 % of
    /// the acceleration's power.
    pub max_frequency_hz: Option<f64>,
    /// End of the low-pass's pass band, Hz; by default 1.15 times the frequency at which the signal sinks into the sensors' noise.
    pub pass_hz: Option<f64>,
}

/// One identified parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Standard error (± 1.96 of it is a 95 % interval).
    pub std_error: f64,
    /// Unit.
    pub unit: String,
}

/// What was used of the record.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RecordUse {
    /// Samples.
    pub samples: usize,
    /// Samples missing.
    pub lost: u64,
    /// Unbroken stretches.
    pub segments: usize,
}

impl RecordUse {
    /// All of these records.
    pub(crate) fn of(records: &[Record]) -> Self {
        Self {
            samples: records.iter().map(Record::samples).sum(),
            lost: records.iter().map(|r| r.losses.lost()).sum(),
            segments: records.iter().map(|r| r.segments.len()).sum(),
        }
    }
}

/// How the numbers came about.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Details {
    /// Length of a window, s.
    pub window_s: f64,
    /// Number of windows.
    pub windows: usize,
    /// Highest frequency of the test functions, Hz.
    pub max_frequency_hz: f64,
    /// Pass band of the low-pass, Hz.
    pub pass_hz: f64,
    /// Start of its stop band, Hz.
    pub stop_hz: f64,
    /// Pass band of the low-pass for signs of velocities, Hz.
    pub sign_pass_hz: f64,
    /// Standard deviation of each sensor's noise, rad.
    pub noise_rad: Vec<f64>,
    /// Bias by that noise, taken off each coefficient (in the order of `correlation_names`).
    pub noise_bias: Vec<f64>,
    /// Condition number of each equation (columns scaled).
    pub condition: Vec<f64>,
    /// Correlation of residuals between windows that do not overlap (a periodic record: near 1).
    pub repetition: f64,
    /// Blocks of the jackknife; 0 where there are too few windows.
    pub jackknife_blocks: usize,
    /// Misfit of the ties between the coefficients and its degrees of freedom, where physical parameters were fitted.
    pub ties_misfit: Option<(f64, usize)>,
    /// ε of each equation that the sensors' noise alone would give; empty where it could not be simulated.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub expected_error: Vec<f64>,
    /// Weighted residual power over that which the sensors' noise alone leaves in the same rows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual_over_noise: Option<f64>,
    /// Share of the right-hand side that the model leaves, over all samples, of each equation of a model file.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub balance_error: Vec<f64>,
    /// Instruments, where the noise called for them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub instruments: Option<instruments::Instruments>,
}

impl Details {
    /// How the weak form's numbers came about: from so many windows, with each sensor's noise and the bias taken off.
    fn of(
        solution: &regression::Solution,
        count: usize,
        (windows, kernels): (&Windows, &Kernels),
        noise_rad: Vec<f64>,
        bias: Option<&noise_bias::Bias>,
    ) -> Self {
        Self {
            window_s: windows.length_s,
            windows: count,
            max_frequency_hz: windows.frequencies as f64 / windows.length_s,
            pass_hz: kernels.full.pass_hz,
            stop_hz: kernels.full.stop_hz,
            sign_pass_hz: kernels.clear.pass_hz,
            noise_rad,
            noise_bias: bias.map_or_else(Vec::new, |b| b.value.iter().copied().collect()),
            condition: solution.condition.clone(),
            repetition: solution.repetition,
            jackknife_blocks: solution.blocks,
            ties_misfit: None,
            expected_error: bias.map_or_else(Vec::new, |b| b.error.clone()),
            residual_over_noise: bias.map(|b| b.noise.powi(-2)).filter(|r| r.is_finite()),
            balance_error: Vec::new(),
            instruments: None,
        }
    }
}

/// Residuals of one equation, for figure 3.14: at most 2000 dots.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Residuals {
    /// Spacing of the test functions' frequencies, Hz.
    pub frequency_step_hz: f64,
    /// Rms residual at each frequency (index 0 is frequency 0).
    pub rms: Vec<f64>,
    /// [frequency index, prediction, residual] of each dot.
    pub dots: Vec<(usize, f64, f64)>,
}

/// Result of an identification.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Identification {
    /// Model.
    pub model: String,
    /// Method.
    pub method: String,
    /// Parameters: coefficients in the order of (3.4), then physical ones.
    pub parameters: Vec<Parameter>,
    /// ε = ‖e‖∞/‖q̂‖∞ of each equation.
    pub identification_error: Vec<f64>,
    /// Balance equations used.
    pub equations_used: usize,
    /// Balance equations dropped.
    pub equations_dropped: usize,
    /// Sets of coefficients that this record does not tell apart.
    pub groups_not_separable: Vec<Vec<String>>,
    /// What was used of the record.
    pub record: RecordUse,
    /// Correlation matrix of the coefficients `correlation_names`.
    pub correlation: Vec<Vec<f64>>,
    /// Names of its rows.
    pub correlation_names: Vec<String>,
    /// How the numbers came about.
    pub details: Details,
    /// How multiple shooting came about them, where it did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shooting: Option<shooting::Details>,
    /// Why these are the weak form's numbers, where no method was asked for: see [`best`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_by_shooting: Option<String>,
    /// Things noticed.
    pub warnings: Vec<Warning>,
    /// Residuals, equation by equation.
    pub residuals: Vec<Residuals>,
    /// What a harmonic balance tells beside the parameters.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub balance: Option<harmonic_balance::account::Account>,
}

/// The bound on ε beyond which an identification is called unsatisfactory (section 3: 10 %).
pub const ERROR_BOUND: f64 = 0.10;

impl Identification {
    /// A parameter by name.
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|p| p.name == name)
    }

    /// Whether every equation's ε keeps its bound.
    pub fn within_bound(&self) -> bool {
        self.identification_error.iter().all(|e| *e <= ERROR_BOUND)
    }
}

/// The nominal dampings of a rig.
pub fn dampings(rig: &Rig) -> Result<Vec<&'static Damping>> {
    let names: Vec<&str> = match &rig.nominal {
        Some(list) => list.iter().map(String::as_str).collect(),
        None => DEFAULT_DAMPINGS.to_vec(),
    };
    let mut out: Vec<&'static Damping> = Vec::new();
    for name in names {
        let damping = DAMPINGS.iter().find(|d| d.id == name).ok_or_else(|| {
            let ids: Vec<&str> = DAMPINGS.iter().map(|d| d.id).collect();
            BadInput::new(format!("\"{name}\""), format!("one of {}", ids.join(", ")))
                .in_file(&rig.path)
                .at("nominal.effects")
                .remedy("Correct the nominal model's dampings")
        })?;
        if out.contains(&damping) {
            return Err(BadInput::new(format!("\"{name}\" a second time"), "each effect once")
                .in_file(&rig.path)
                .at("nominal.effects"));
        }
        out.push(damping);
    }
    Ok(out)
}

/// Windows and low-passes of an analysis.
#[derive(Clone, Debug)]
pub struct Geometry {
    /// Test functions.
    pub windows: Windows,
    /// Low-passes.
    pub kernels: Kernels,
}

/// A record made ready for the weak form.
pub struct Prepared {
    /// Angles over unbroken stretches of steady drive.
    pub segments: Vec<AngleSegment>,
    /// Standard deviation of each sensor's noise, rad.
    pub sigma: [f64; 2],
    /// Windows and low-passes.
    pub geometry: Geometry,
    /// Things noticed.
    pub warnings: Vec<Warning>,
}

/// Angles, noise, windows and low-passes of one or several records of a double pendulum.
///
/// # Errors
/// As [`identify`].
pub fn prepare(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Prepared> {
    if rig.model != "double-pendulum" {
        return Err(BadInput::new(format!("\"{}\"", rig.model), "\"double-pendulum\"")
            .in_file(&rig.path)
            .at("model")
            .remedy("`whirl list models` shows the models"));
    }
    prepare_system(&System::of(rig)?, records, rig, settings)
}

/// Angles, noise, windows and low-passes of one or several records of a built-in system.
///
/// # Errors
/// As [`identify`].
pub fn prepare_system(system: &System, records: &[Record], rig: &Rig, settings: &Settings) -> Result<Prepared> {
    let step_s = 1.0 / rig.sample_rate_hz;
    let mut warnings: Vec<Warning> = records.iter().flat_map(|r| r.warnings.clone()).collect();
    let (records, restarted) = boots::of_known_zero(records);
    let records = &*records;
    warnings.extend(restarted);
    let mut segments = Vec::new();
    for record in records {
        for segment in system.segments(record, rig)? {
            segments.push(segment);
        }
    }
    keep_steady_drive(records, &mut segments, rig, &mut warnings)?;
    standstill::leave_out(&mut segments, settings, rig.drive.map_or(4.0, |d| 20.0 / d.frequency_hz), &mut warnings);
    let noise_of = |i: usize| {
        let sensors: Vec<Cow<'_, [f64]>> = segments.iter().map(|s| s.sensor(i)).collect();
        noise::estimate(sensors.iter().map(|s| &s[..]), step_s)
    };
    let (first, second) = rayon::join(|| noise_of(0), || noise_of(1));
    let noises: [Option<noise::Noise>; 2] = [first, second];
    let band = if rig.drive.is_none() {
        let sensors: Vec<Vec<Cow<'_, [f64]>>> =
            (0..2).map(|i| segments.iter().map(|s| s.sensor(i)).collect()).collect();
        free_geometry::band(sensors.iter().map(|s| s.iter().map(|x| &x[..])), step_s)
    } else {
        None
    };
    let lengths: Vec<f64> = segments.iter().map(|s| s.len() as f64 * s.step_s).collect();
    let (windows, kernels) = geometry::geometry(rig, settings, &noises, step_s, (band, &lengths))?;
    let needed = windows::samples_needed(&windows, &kernels, step_s);
    let longest = segments.iter().map(AngleSegment::len).max().unwrap_or(0);
    if longest < needed {
        let mut error = BadInput::new(
            format!("{longest} samples ({:.3} s) in the longest unbroken stretch", longest as f64 * step_s),
            format!(
                "at least {needed} ({:.3} s): one window of {:.3} s and the low-pass's reach on either side",
                needed as f64 * step_s,
                windows.length_s
            ),
        )
        .remedy("Record longer, or choose a shorter window with --window-s");
        if let Some(r) = records.first() {
            error = error.in_file(&r.path);
        }
        return Err(error);
    }
    let sigma = noises.map(|n| n.map_or(0.0, |n| n.sigma));
    Ok(Prepared { segments, sigma, geometry: Geometry { windows, kernels }, warnings })
}

/// Identifies a system from one or several records of the same rig by the weak form, and says what the record or the rig file seems to have wrong.
///
/// # Errors
/// As [`weak_form`].
pub fn identify(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Identification> {
    let mut result = weak_form(records, rig, settings)?;
    let suspects = suspects::after(records, rig, &result);
    result.warnings.extend(suspects);
    Ok(result)
}

/// Identifies a system from one or several records of the same rig by the weak form.
///
/// # Errors
/// A model that is not built in, missing channels, settings out of range, records shorter than one window, or
/// a record in which a coefficient's column vanishes (an arm at rest).
pub fn weak_form(records: &[Record], rig: &Rig, settings: &Settings) -> Result<Identification> {
    if let Some(bound) = &rig.bound {
        return general::identify(records, rig, bound, settings);
    }
    let system = System::of(rig)?;
    let Prepared { segments, mut sigma, geometry: Geometry { windows, kernels }, mut warnings } =
        prepare_system(&system, records, rig, settings)?;
    let model = system.weak_model(rig);
    let rows = windows::rows(&segments, &model, &kernels, &windows);
    let terms: Vec<usize> = model.equations.iter().map(|e| e.terms.len()).collect();
    let mut solution = regression::solve(&rows, &terms, windows.frequencies).map_err(|e| {
        let error = match e {
            Unsolvable::Dependent { equation, column } => BadInput::new(
                format!("nothing in the record that determines {}", model.equations[equation].terms[column].name),
                "motion in which every term of the equations takes part",
            )
            .remedy("Is an arm at rest, is a channel dead or named twice, does the shaker run? See `whirl inspect`"),
            Unsolvable::NotFinite => {
                BadInput::new("a value too large to compute with", "angles in the unit that the rig file names")
            }
        };
        match records.first() {
            Some(r) => error.in_file(&r.path),
            None => error,
        }
    })?;
    let found = DVector::from_iterator(terms.iter().sum(), solution.coefficients.iter().flatten().copied());
    let fitted = solution.coefficients.clone();
    let heavy = instruments::wanted(&model, sigma[0])
        .then(|| instruments::solve(&segments, &model, &kernels, &windows, sigma[0]))
        .flatten();
    let bias = if let Some(heavy) = &heavy {
        solution.coefficients = heavy.coefficients.clone();
        solution.covariance = heavy.covariance.clone();
        None
    } else {
        let dynamics = system.dynamics(rig);
        let moves = (&*dynamics, rig.drive.map_or(0.0, |_| rig.omega()));
        let weights = &solution.weights;
        let counted = [0, 1].map(|c: usize| segments.iter().all(|s| s.count_rad[c].is_some()));
        noise_bias::with_noise_that_fits(&mut sigma, &counted, |sigma| {
            let sigma = [sigma[0], sigma[1]];
            let chain = chain_bias::estimate(moves, &found, &segments, &model, &kernels, &windows, weights, sigma);
            chain.or_else(|| noise_bias::estimate(&segments, &model, &kernels, &windows, weights, sigma))
        })
    };
    if let Some(bias) = &bias {
        bias.take_off(&mut solution);
    }
    if solution.repeating {
        warnings.push(Warning::new(
            "periodic-record",
            format!("residuals repeat from window to window (correlation {:.2}): the motion is locked to the drive or periodic", solution.repetition),
            "Quantisation errors repeat with it and do not average out; standard errors were widened for that. Change the drive's amplitude or frequency until the motion is chaotic, or count more lines a turn",
        ));
    }
    warnings.extend(few_windows(&solution, rows.len()));
    let names: Vec<String> = model.equations.iter().flat_map(|e| e.terms.iter().map(|t| t.name.clone())).collect();
    let units: Vec<&str> = model.equations.iter().flat_map(|e| e.terms.iter().map(|t| t.unit)).collect();
    let values = DVector::from_iterator(names.len(), solution.coefficients.iter().flat_map(|c| c.iter().copied()));
    let covariance = &solution.covariance;
    let groups = identifiability::groups_not_separable(&names, &values, covariance);
    let mut parameters = ordered_parameters(&names, &units, &values, covariance);
    let mut ties_misfit = None;
    if let Some(fit) = system.physical(&names, &values, covariance, &solution.metric, rig) {
        ties_misfit = (fit.freedom > 0).then_some((fit.misfit, fit.freedom));
        parameters.extend(fit.parameters.iter().map(|p| Parameter {
            name: p.name.to_owned(),
            value: p.value,
            std_error: p.std_error,
            unit: p.unit.to_owned(),
        }));
        if !fit.undetermined.is_empty() {
            warnings.push(Warning::new(
                "undetermined",
                format!("the known quantities leave {} open", fit.undetermined.join(", ")),
                "Add what is known (a mass, a length, an amplitude) to [known] in the rig file",
            ));
        }
    }
    let correlation = correlation_of(covariance);
    let length_s = windows.length_s;
    let mut result = Identification {
        model: model.name.clone(),
        method: "weak".to_owned(),
        parameters,
        identification_error: solution.error.clone(),
        equations_used: regression::rows_used(&rows, model.equations.len(), windows.frequencies),
        equations_dropped: 0,
        groups_not_separable: groups,
        record: RecordUse::of(records),
        correlation,
        correlation_names: names,
        details: Details {
            ties_misfit,
            instruments: heavy.map(|h| h.done),
            ..Details::of(&solution, rows.len(), (&windows, &kernels), sigma.to_vec(), bias.as_ref())
        },
        shooting: None,
        not_by_shooting: None,
        warnings,
        residuals: (0..model.equations.len())
            .map(|e| Residuals {
                frequency_step_hz: 1.0 / length_s,
                rms: solution.residual_rms[e].clone(),
                dots: regression::residual_dots(&rows, e, &fitted[e], 2000),
            })
            .collect(),
        balance: None,
    };
    judgement::judge(&mut result, rig);
    Ok(result)
}

/// The warning where windows are too few for a jackknife.
fn few_windows(solution: &regression::Solution, windows: usize) -> Option<Warning> {
    (solution.blocks == 0).then(|| {
        Warning::new(
            "few-windows",
            format!("{windows} windows are too few to measure how residuals scatter"),
            "Standard errors assume white sensor noise; record longer",
        )
    })
}

/// Correlation matrix of a covariance.
fn correlation_of(covariance: &DMatrix<f64>) -> Vec<Vec<f64>> {
    let n = covariance.nrows();
    (0..n)
        .map(|i| {
            (0..n)
                .map(|j| {
                    let d = (covariance[(i, i)] * covariance[(j, j)]).sqrt();
                    if d > 0.0 { covariance[(i, j)] / d } else { f64::from(u8::from(i == j)) }
                })
                .collect()
        })
        .collect()
}

/// Cuts segments to the stretches over which the device's drive ran steadily.
fn keep_steady_drive(
    records: &[Record],
    segments: &mut Vec<AngleSegment>,
    rig: &Rig,
    warnings: &mut Vec<Warning>,
) -> Result<()> {
    if rig.drive.is_none() {
        return Ok(());
    }
    let all: Vec<&Vec<u32>> =
        records.iter().flat_map(|r| &r.segments).filter_map(|s| s.amplitude_nm.as_ref()).collect();
    if all.len() != segments.len() || all.is_empty() {
        return Ok(());
    }
    let Some(target) = all.iter().flat_map(|a| a.iter().copied()).max() else { return Ok(()) };
    if target == 0 {
        return Err(BadInput::new(
            "a record whose shaker never moved",
            "motion of the base, since the rig file has [drive]",
        )
        .in_file(records.first().map(|r| r.path.clone()).unwrap_or_default())
        .remedy("Start the shaker during the capture, or leave [drive] out of the rig file"));
    }
    if all.iter().all(|a| a.iter().all(|a| *a == target)) {
        return Ok(());
    }
    let mut steady = Vec::new();
    let mut dropped = 0;
    for (segment, amplitude) in segments.drain(..).zip(all) {
        let mut start = 0;
        for run in amplitude.chunk_by(|a, b| a == b) {
            if run[0] == target {
                steady.push(segment.part(start, start + run.len()));
            } else {
                dropped += run.len();
            }
            start += run.len();
        }
    }
    if dropped > 0 {
        warnings.push(Warning::new(
            "drive-not-steady",
            format!("{dropped} samples were taken while the shaker's amplitude was not {} µm", f64::from(target) / 1e3),
            "They were left out; start the capture when the shaker runs to use all of it",
        ));
    }
    *segments = steady;
    Ok(())
}

/// Coefficients with standard errors in the order B11 … B15, B21 … B25, C…; B_i5 = √(B_i3² + B_i4²) is added.
fn ordered_parameters(
    names: &[String],
    units: &[&str],
    values: &DVector<f64>,
    covariance: &DMatrix<f64>,
) -> Vec<Parameter> {
    let mut out: Vec<Parameter> = (0..names.len())
        .map(|i| Parameter {
            name: names[i].clone(),
            value: values[i],
            std_error: covariance[(i, i)].max(0.0).sqrt(),
            unit: units[i].to_owned(),
        })
        .collect();
    for n in ["1", "2"] {
        let find = |k: &str| names.iter().position(|x| *x == format!("B{n}{k}"));
        if let (Some(c), Some(s)) = (find("3"), find("4")) {
            let (x, y) = (values[c], values[s]);
            let size = x.hypot(y);
            let variance = if size > 0.0 {
                (x * x * covariance[(c, c)] + 2.0 * x * y * covariance[(c, s)] + y * y * covariance[(s, s)])
                    / (size * size)
            } else {
                covariance[(c, c)].max(covariance[(s, s)])
            };
            let parameter = Parameter {
                name: format!("B{n}5"),
                value: size,
                std_error: variance.max(0.0).sqrt(),
                unit: "1".to_owned(),
            };
            out.push(parameter);
        }
    }
    out.sort_by(|a, b| a.name.cmp(&b.name));
    out
}

/// Angular frequency of a drive, rad/s.
pub fn angular_frequency(frequency_hz: f64) -> f64 {
    TAU * frequency_hz
}
