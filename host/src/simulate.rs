//! Records of a simulated rig, straight from hil-sim's plant. The only room, with `capture`'s
//! source `sim` and the demo, that sees a rig file's `[plant]`.

pub mod own_effects;

use std::path::Path;

use indicatif::ProgressBar;
use serde::Serialize;
use whirl_hil_sim::{
    BaseQuantity, BaseSettings, Direction as SimDirection, DriveSettings, Effect, Parameters, SecondEncoder,
    Simulation, SimulationSettings,
};

use crate::error::{BadInput, Result};
use crate::record::writer::{RecordWriter, Sample};
use crate::record::{Losses, Metadata};
use crate::rig::measures::BASE;
use crate::rig::plant::{BasePlant, Plant};
use crate::rig::single_plant::SinglePlant;
use crate::rig::{Channel, Direction, Rig, check_seconds};
use crate::wording::close::did_you_mean;

/// Longest simulated record that is written as it comes, samples: as many as are read.
const MOST_SAMPLES: f64 = 2e8;

/// What was simulated.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Samples.
    pub samples: u64,
    /// Length, s.
    pub seconds: f64,
    /// Seed.
    pub seed: u64,
    /// Effects put in.
    pub effects: Vec<String>,
}

/// What was taken for parameters that the texts of effects leave out, a sentence for each effect.
pub fn taken_for(texts: &[String]) -> Vec<String> {
    let one = |text: &String| {
        let effect = Effect::parse(text).ok()?;
        let given: Vec<&str> = text.split(',').skip(1).filter_map(|p| Some(p.split_once('=')?.0.trim())).collect();
        let open = effect.info.parameters.iter().zip(&effect.parameters).filter(|(p, _)| !given.contains(&p.name));
        let list: Vec<String> = open
            .map(|(p, (name, value))| match p.unit {
                "" | "1" => format!("{name} = {value}"),
                unit => format!("{name} = {value} {unit}"),
            })
            .collect();
        let at = format!("{}@{}", effect.info.id, effect.place.name());
        (!list.is_empty()).then(|| format!("{at} was put in with {}, which --effect does not say", list.join(", ")))
    };
    texts.iter().filter_map(one).collect()
}

/// Most counts a turn of a simulated encoder, 2²⁰.
const MOST_COUNTS: u32 = 1_048_576;

/// The nominal rig of a `[plant]`.
pub fn parameters(plant: &Plant) -> Parameters {
    Parameters {
        m1: plant.m1,
        e1: plant.e1,
        l1: plant.l1,
        m2: plant.m2,
        e2: plant.e2,
        j_o1: plant.j_o1,
        j_o2: plant.j_o2,
        tau_c1: plant.tau_c1,
        c_r2: plant.c_r2,
        g: plant.g,
    }
}

/// Effects from their texts.
///
/// # Errors
/// Names the part of the text at fault.
pub fn effects(texts: &[String]) -> Result<Vec<Effect>> {
    texts
        .iter()
        .map(|t| {
            Effect::parse(t).map_err(|e| {
                let is_id = e.place == "effect id";
                let id = t.split('@').next().unwrap_or_default().trim();
                let meant = did_you_mean(id, whirl_hil_sim::plant::effects::LIST.iter().map(|i| i.id));
                let own = if is_id {
                    "; one of an effect file is put in where the rig file names it, effects = [\"FILE.toml\"]"
                } else {
                    ""
                };
                BadInput::new(e.found, e.expected).at(format!("--effect {t}, {}", e.place)).remedy(format!(
                    "{}`whirl list effects` shows them with their units{own}",
                    if is_id { meant.as_str() } else { "" }
                ))
            })
        })
        .collect()
}

/// Counts a turn of both encoders, and what encoder 2 is fixed to.
///
/// # Errors
/// A rig whose channels are not two encoders in counts.
pub fn encoders(rig: &Rig) -> Result<([u32; 2], SecondEncoder)> {
    let bad = |found: String, expected: &str| {
        BadInput::new(found, expected)
            .in_file(&rig.path)
            .at("channel")
            .remedy("A simulated rig has two encoders that count")
    };
    let list: Vec<&Channel> = rig.channel.iter().filter(|c| c.measures != BASE).collect();
    let [first, second] = list[..] else {
        return Err(bad(format!("{} encoders", list.len()), "two: theta1 (or phi1), then theta2 (or phi2)"));
    };
    if !["theta1", "phi1"].contains(&first.measures.as_str()) {
        return Err(bad(format!("\"{}\" first", first.measures), "theta1 or phi1"));
    }
    let fixed_to = match second.measures.as_str() {
        "theta2" => SecondEncoder::Relative,
        "phi2" => SecondEncoder::Absolute,
        other => return Err(bad(format!("\"{other}\" second"), "theta2 or phi2")),
    };
    match (first.counts_per_turn, second.counts_per_turn) {
        (Some(a), Some(b)) => {
            list.iter().try_for_each(|c| simulated_turn(rig, c))?;
            Ok(([a, b], fixed_to))
        }
        _ => Err(bad("a unit other than \"count\"".to_owned(), "unit = \"count\" for both")),
    }
}

/// Refuses an encoder of more counts a turn than a simulated one has.
fn simulated_turn(rig: &Rig, channel: &Channel) -> Result<()> {
    match channel.counts_per_turn {
        Some(n) if n > MOST_COUNTS => {
            Err(BadInput::new(n.to_string(), format!("1 to {MOST_COUNTS} for an encoder that is simulated"))
                .in_file(&rig.path)
                .at(format!("channel \"{}\", counts_per_turn", channel.name))
                .remedy("Simulate with fewer counts a turn; records of more are read"))
        }
        _ => Ok(()),
    }
}

/// The simulated sensor of the base's motion, where the rig has a channel of it: an encoder for a
/// position, a converter for an acceleration.
///
/// # Errors
/// A channel without what a count is worth.
pub fn base(rig: &Rig, plant: &BasePlant, seed: u64) -> Result<Option<BaseSettings>> {
    let Some(channel) = rig.base().and_then(|i| rig.channel.get(i)) else { return Ok(None) };
    let Some(gain) = channel.gain else {
        return Err(BadInput::new("a channel of the base without gain", "what a count is worth, in its unit")
            .in_file(&rig.path)
            .at(format!("channel \"{}\"", channel.name))
            .remedy("Add it, such as unit = \"m\" and gain = 5e-6 for an encoder of 5 µm"));
    };
    // A sensor that is mounted the other way round shows the opposite.
    let sign = gain.signum();
    Ok(Some(BaseSettings {
        quantity: if channel.unit == "m/s2" { BaseQuantity::Acceleration } else { BaseQuantity::Counted },
        scale: gain.abs() * channel.scale(),
        gain: sign * plant.gain,
        // The rig file's own offset is added when the record is read.
        offset: sign * (plant.offset - channel.offset.unwrap_or(0.0) * channel.scale()),
        noise: plant.noise,
        seed,
    }))
}

/// Settings of the direct simulation of a rig.
///
/// # Errors
/// A rig without `[plant]`, of another model, or with values out of range.
pub fn settings(rig: &Rig, effect_texts: &[String], seconds: f64, seed: u64) -> Result<SimulationSettings> {
    if !["double-pendulum", "single-pendulum"].contains(&rig.model.as_str()) {
        return Err(rig.no_such_model());
    }
    check_seconds(seconds, rig.sample_rate_hz, MOST_SAMPLES)?;
    let drive = |amplitude_m: f64, psi: f64| {
        rig.drive.map(|d| DriveSettings {
            direction: match d.direction {
                Direction::Vertical => SimDirection::Vertical,
                Direction::Horizontal => SimDirection::Horizontal,
            },
            frequency_hz: d.frequency_hz,
            amplitude_m,
            psi,
        })
    };
    let common = SimulationSettings {
        sample_rate_hz: rig.sample_rate_hz,
        record_s: seconds,
        effects: effects(effect_texts)?,
        seed: Some(seed),
        ..SimulationSettings::default()
    };
    if rig.model == "single-pendulum" {
        let plant = SinglePlant::of(rig)?;
        let mut settings = SimulationSettings {
            parameters: Parameters::single(plant.m1, plant.e1, plant.j_o1, plant.tau_c1, plant.g),
            drive: drive(plant.amplitude_m, plant.phase_rad),
            counts_per_turn: [single_encoder(rig)?, 4096],
            base: base(rig, &plant.base, seed)?,
            second: SecondEncoder::Absolute,
            initial: [plant.initial[0], 0.0, plant.initial[1], 0.0],
            settle_s: plant.settle_s,
            ..common
        };
        if plant.c_r1 > 0.0 {
            settings.effects.extend(effects(&[format!("viscous-friction@joint1={:e}", plant.c_r1)])?);
        }
        return Ok(settings);
    }
    let plant = Plant::of(rig)?;
    let (counts_per_turn, second) = encoders(rig)?;
    Ok(SimulationSettings {
        base: base(rig, &plant.base, seed)?,
        parameters: parameters(&plant),
        drive: drive(plant.amplitude_m, plant.phase_rad),
        counts_per_turn,
        second,
        initial: plant.initial,
        settle_s: plant.settle_s,
        ..common
    })
}

/// Counts a turn of a single pendulum's encoder.
///
/// # Errors
/// A rig whose only channel is not an encoder in counts.
fn single_encoder(rig: &Rig) -> Result<u32> {
    let list: Vec<&Channel> = rig.channel.iter().filter(|c| c.measures != BASE).collect();
    list.iter().try_for_each(|c| simulated_turn(rig, c))?;
    match list[..] {
        [only] if ["theta1", "phi1"].contains(&only.measures.as_str()) => only.counts_per_turn,
        _ => None,
    }
    .ok_or_else(|| {
        BadInput::new(format!("{} encoders", list.len()), "one: theta1 (or phi1), with unit = \"count\"")
            .in_file(&rig.path)
            .at("channel")
            .remedy("A simulated single pendulum has one encoder that counts")
    })
}

/// Simulates `seconds` of a rig and writes the record.
///
/// # Errors
/// As [`settings`]; a plant that cannot be integrated; a file that cannot be written.
pub fn record(
    rig: &Rig,
    effect_texts: &[String],
    seconds: f64,
    seed: u64,
    output: &Path,
    progress: &ProgressBar,
) -> Result<Summary> {
    let settings = settings(rig, effect_texts, seconds, seed)?;
    let fail = |e: whirl_hil_sim::SimulationError| {
        BadInput::new(e.to_string(), "")
            .in_file(&rig.path)
            .at("[plant]")
            .remedy("Correct the plant or the effects put into it")
    };
    let mut simulation = Simulation::new(&settings).map_err(fail)?;
    let metadata = Metadata {
        rig: rig.text.clone(),
        firmware: format!("whirl-hil-sim {}", env!("CARGO_PKG_VERSION")),
        board: "none (simulated plant)".to_owned(),
        started_at: None,
        source: "simulate".to_owned(),
        written_by: format!("whirl {}", env!("CARGO_PKG_VERSION")),
        sample_rate_hz: rig.sample_rate_hz,
        boots: Vec::new(),
        device: Vec::new(),
        lines: Vec::new(),
        excitation: None,
        table: Vec::new(),
        level: None,
    };
    // At least one sample, at most a day of them: no overflow.
    let samples = ((seconds * rig.sample_rate_hz).round() as u64).max(1);
    let mut writer = RecordWriter::create_beside(output, &metadata, rig)?;
    progress.set_length(samples);
    let mut counts = Vec::new();
    for i in 0..samples {
        let s = simulation.next_sample().map_err(fail)?;
        let mut encoders = s.counts.iter();
        counts.clear();
        for c in &rig.channel {
            // The base's sensor takes its gain and offset off itself, see [`base`].
            let shown =
                if c.measures == BASE { Some(s.base) } else { encoders.next().and_then(|n| c.count_taken_off(*n)) };
            counts.push(shown.ok_or_else(|| {
                BadInput::new("an angle beyond 32 bits of counts", "fewer turns")
                    .in_file(&rig.path)
                    .at(format!("channel \"{}\"", c.name))
                    .remedy("Simulate a shorter time, or a smaller offset")
            })?);
        }
        writer.push(&Sample { tick: s.tick, counts: &counts, phase: s.phase, amplitude_nm: s.amplitude_nanometre })?;
        if i.is_multiple_of(1000) {
            progress.set_position(i);
        }
    }
    writer.finish(&Losses { received: samples, ..Losses::default() })?;
    progress.finish_and_clear();
    Ok(Summary {
        samples,
        seconds: samples as f64 / rig.sample_rate_hz,
        seed,
        effects: settings.effects.iter().take(effect_texts.len()).map(ToString::to_string).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Column, ReadOptions, Record};
    use crate::rig::choices::Choices;

    #[test]
    fn what_the_text_of_an_effect_leaves_out_is_told() {
        let told = |text: &str| taken_for(&[text.to_owned()]);
        let all = told("cogging@joint1=1e-4").concat();
        assert!(all.starts_with("cogging@joint1 was put in with n = 6, psi = 0"), "{all}");
        let psi = told("cogging@joint1=1e-4, n=7").concat();
        assert!(psi.contains("psi = 0") && !psi.contains("n = "), "{psi}");
        assert!(told("cogging@joint1=1e-4,n=7,psi=0.1").is_empty() && told("quadratic-drag@arm2=2e-6").is_empty());
    }

    /// What a rig of this text simulates, read back with the same text.
    fn simulated(text: &str, ending: &str) -> Record {
        let rigs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/rig.toml");
        let rig = Rig::of_text(text, &rigs, &Choices::default(), &mut |_| Ok(None)).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(format!("r{ending}"));
        match &rig.bound {
            Some(bound) => {
                crate::model::model_file::simulation::record(&rig, bound, &[], 2.0, 1, &path).map(drop).unwrap();
            }
            None => record(&rig, &[], 2.0, 1, &path, &ProgressBar::hidden()).map(drop).unwrap(),
        }
        Record::read(&path, &rig, &ReadOptions::default()).unwrap()
    }

    fn shipped(name: &str) -> String {
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(name)).unwrap()
    }

    #[test]
    fn a_rig_file_reads_the_motion_that_it_simulates_whatever_its_time_gain_and_offset() {
        let model = shipped("duffing.toml");
        let scaled = model
            .replace("unit = \"m\"\n", "unit = \"m\"\ngain = 0.01\noffset = 0.5\n")
            .replace("unit = \"N\"\n", "unit = \"N\"\ngain = -2.0\n")
            .replace("sample_rate_hz", "time = \"clock\"\ntime_unit = \"ms\"\nsample_rate_hz");
        let pendulum = shipped("seed.toml").replace("settle_s = 20.0", "settle_s = 0.0");
        let turned = pendulum
            .replace("counts_per_turn = 1024\n\n[[", "counts_per_turn = 1024\ngain = -1\noffset = 300\n\n[[")
            .replace("sample_rate_hz", "time = \"clock\"\nsample_rate_hz");
        assert!(turned.contains("offset = 300") && scaled.contains("gain = -2.0"));
        for (plain, other) in [(&model, &scaled), (&pendulum, &turned)] {
            for ending in [".csv", ".parquet"] {
                let [a, b] = [plain, other].map(|text| simulated(text, ending));
                let (a, b) = (&a.segments[0], &b.segments[0]);
                assert!((a.start_s - b.start_s).abs() < 1e-9 && (a.step_s - b.step_s).abs() < 1e-9, "{ending}");
                for (x, y) in a.columns.iter().zip(&b.columns) {
                    match (x, y) {
                        (Column::Counts(x), Column::Counts(y)) => assert_eq!(x, y, "{ending}"),
                        (Column::Values(x), Column::Values(y)) => {
                            assert!(x.iter().zip(y).all(|(x, y)| (x - y).abs() < 1e-9), "{ending}");
                        }
                        _ => panic!("columns of two kinds"),
                    }
                }
            }
        }
    }
}
