//! Effects of the user's own put into a built-in pendulum: its plant as one of the system file that
//! ships with the program, where any effect has its places.

use core::fmt::Write;
use std::path::Path;

use whirl_hil_sim::simulate::perturbed;

use super::Summary;
use crate::error::{BadInput, Result};
use crate::model::model_file::simulation;
use crate::record::Column;
use crate::record::values::write_values;
use crate::rig::plant::Plant;
use crate::rig::single_plant::SinglePlant;
use crate::rig::{Direction, Rig, as_own};
use crate::system::library::Pendulum;

/// Whether one of the texts names an effect of the rig's own effect files.
pub fn are_asked(rig: &Rig, texts: &[String]) -> bool {
    texts.iter().any(|t| rig.effects.iter().any(|e| t.split('@').next().is_some_and(|id| id.trim() == e.id)))
}

/// `[plant]` of a system file and the nominal effects of a plant: parameters above, then frictions.
fn told(
    parameters: &[(&str, f64)],
    frictions: [(&str, f64); 2],
    initial: &[f64],
    settle_s: f64,
) -> (String, Vec<String>) {
    let mut text = "[plant]\n".to_owned();
    let mut nominal = Vec::new();
    // Writing into a string cannot fail.
    for (name, value) in parameters {
        let _ = writeln!(text, "{name} = {value:?}");
    }
    for (id, value) in frictions.into_iter().filter(|f| f.1 > 0.0) {
        let _ = writeln!(text, "\"{id}\" = {value:?}");
        nominal.push(id.to_owned());
    }
    let _ = writeln!(text, "initial = {initial:?}\nsettle_s = {settle_s:?}");
    (text, nominal)
}

/// The rig as one of the system file of bodies that is the same pendulum, begun as the seed says.
///
/// # Errors
/// A rig without `[plant]`, or with a channel of the base; arms that no bodies are.
fn of_bodies(rig: &Rig, seed: u64) -> Result<Rig> {
    if rig.base().is_some() {
        let expected = "the base at rest or driven by a sine, for an effect of an effect file in a built-in pendulum";
        return Err(BadInput::new("a channel that measures the base", expected)
            .in_file(&rig.path)
            .at("--effect")
            .remedy("Leave the channel out, or name a system file as model (`whirl list models --show double-pendulum-measured-base`)"));
    }
    let [joint1, joint2] = ["joint1", "joint2"];
    let name = |id: &str, joint: &str| format!("{id}@{joint}");
    if rig.pendulum() == Some(Pendulum::Single) {
        let p = SinglePlant::of(rig)?;
        let a = if rig.drive.is_some() { p.amplitude_m } else { 0.0 };
        let (cos, sin) = (a * p.phase_rad.cos(), a * p.phase_rad.sin());
        // x_b = a sin(τ − ψ) sideways, y = a cos(τ − ψ) up and down.
        let [a_c, a_s] = if rig.direction() == Some(Direction::Horizontal) { [-sin, cos] } else { [cos, sin] };
        let parameters = [("S", p.m1 * p.e1), ("J", p.j_o1), ("a_c", a_c), ("a_s", a_s), ("g", p.g)];
        let (viscous, coulomb) = (name("viscous-friction", joint1), name("coulomb-friction", joint1));
        let [angle, rate] = p.initial;
        let begun = perturbed([angle, 0.0, rate, 0.0], seed);
        let initial = [begun[0], begun[2]];
        let (text, nominal) = told(&parameters, [(&viscous, p.c_r1), (&coulomb, p.tau_c1)], &initial, p.settle_s);
        return Ok(Rig { text, ..as_own::single_pendulum_of_bodies(rig, &nominal)? });
    }
    let p = Plant::of(rig)?;
    let (cos, sin) = (p.amplitude_m * p.phase_rad.cos(), p.amplitude_m * p.phase_rad.sin());
    let (j_1, driven) = (p.j_o1 - p.m2 * p.l1 * p.l1, rig.drive.is_some());
    if j_1 < 0.0 {
        let expected = "m2 l1² at least, which it holds beside arm 1's own, for an effect of an effect file";
        return Err(BadInput::new(format!("J_o1 = {}", p.j_o1), expected)
            .in_file(&rig.path)
            .at("plant.J_o1")
            .remedy("Correct J_o1, m2 or l1"));
    }
    let mut parameters = vec![("m1", p.m1), ("e1", p.e1), ("J_1", j_1), ("l1", p.l1), ("m2", p.m2), ("e2", p.e2)];
    parameters.extend([("J_2", p.j_o2), ("g", p.g)]);
    parameters.extend([("a_c", cos), ("a_s", sin)].into_iter().filter(|_| driven));
    let (coulomb, viscous) = (name("coulomb-friction", joint1), name("viscous-friction", joint2));
    let (text, nominal) =
        told(&parameters, [(&coulomb, p.tau_c1), (&viscous, p.c_r2)], &perturbed(p.initial, seed), p.settle_s);
    Ok(Rig { text, ..as_own::double_pendulum_of_bodies(rig, &nominal)? })
}

/// Simulates `seconds` of a built-in pendulum with effects of effect files, and writes the record.
///
/// # Errors
/// A plant or effects that cannot be, a motion that leaves the finite numbers, a file that cannot
/// be written.
pub fn record(rig: &Rig, texts: &[String], seconds: f64, seed: u64, output: &Path) -> Result<Summary> {
    let own = of_bodies(rig, seed)?;
    let Some(bound) = own.bound.clone() else { return Err(rig.no_such_model()) };
    let columns = simulation::columns(&own, &bound, texts, seconds, seed)?;
    write_values(output, rig, &columns)?;
    let samples = columns.first().map_or(0, Column::len) as u64;
    Ok(Summary { samples, seconds: samples as f64 / rig.sample_rate_hz, seed, effects: texts.to_vec() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{ReadOptions, Record};

    const SPRING: &str = "[[effect]]\nid = \"my-spring\"\nat = \"joint\"\nstrengths = [\"k\"]\nforce = \"-k*x\"\n";

    fn rig(name: &str, folder: &Path) -> Rig {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs").join(name);
        let file = folder.join("spring.toml");
        std::fs::write(&file, SPRING).unwrap();
        let mut rig = Rig::read(path).unwrap();
        // A record without a phase begins at the drive's: settled for, it is another history.
        rig.text = rig.text.replace("settle_s = 20.0", "settle_s = 0.0");
        rig.add_effects(&file).unwrap();
        rig
    }

    /// Of no strength it is the built-in plant's own motion; of some it is another.
    #[test]
    fn a_built_in_pendulum_takes_an_effect_of_ones_own() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["single-pendulum.toml", "chaotic.toml"] {
            let rig = rig(name, folder.path());
            let asked = |text: &str| are_asked(&rig, &[text.to_owned()]);
            assert!(asked("my-spring@joint1=1") && !asked("cogging@joint1=1"));
            let counts = |texts: &[String], own: bool, seed: u64| {
                let path = folder.path().join("r.csv");
                let bar = indicatif::ProgressBar::hidden();
                if own {
                    record(&rig, texts, 1.0, seed, &path).unwrap();
                } else {
                    crate::simulate::record(&rig, texts, 1.0, seed, &path, &bar).unwrap();
                }
                let record = Record::read(&path, &rig, &ReadOptions::default()).unwrap();
                match &record.segments[0].columns[0] {
                    Column::Counts(c) => c.clone(),
                    Column::Values(_) => panic!("no counts"),
                }
            };
            let plain = counts(&[], false, 1);
            let none = counts(&["my-spring@joint1=0".to_owned()], true, 1);
            let some = counts(&["my-spring@joint1=1e-3".to_owned()], true, 1);
            let other = counts(&["my-spring@joint1=0".to_owned()], true, 2);
            let apart = |other: &[i32]| plain.iter().zip(other).map(|(a, b)| (a - b).abs()).max().unwrap();
            assert_eq!(plain.len(), none.len());
            assert!(apart(&other) > 20, "{name}: {}", apart(&other));
            assert!(apart(&none) <= 1 && apart(&some) > 20, "{name}: {} {}", apart(&none), apart(&some));
        }
    }
}
