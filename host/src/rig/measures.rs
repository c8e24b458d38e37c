//! What a rig's channels measure, checked against the model: names of a built-in system,
//! coordinates and inputs of a model file.
//!
//! A channel of a model-file rig measures an input, a coordinate, or a sum of coordinates with
//! whole or broken numbers in front (`phi2 - phi1` for an encoder between two arms). Every
//! coordinate must follow from the channels: y = S q with S square and invertible.

use std::path::Path;
use std::sync::Arc;

use nalgebra::DMatrix;

use super::declared::{self, Declared};
use super::{Rig, possible};
use crate::error::{BadInput, Result};
use crate::model::MODELS;
use crate::model::model_file::expression::{Symbol, as_number};
use crate::model::model_file::parser::{Names, parse};
use crate::model::model_file::toml_place::{self, Source};
use crate::model::model_file::units::Unit;
use crate::model::model_file::{self, ModelFile};
use crate::system::bodies::Body;
use crate::system::language::Placed;
use crate::system::library::Pendulum;
use crate::system::{self, library};
use crate::wording::close::did_you_mean;

/// What a channel measures that shows the base's own motion along the drive, as a position or as an
/// acceleration: the input of the systems that have one of that name.
pub const BASE: &str = "base";

/// Units of an acceleration and of positions, for a channel of the base.
const ACCELERATION: &str = "m/s2";
const POSITIONS: [&str; 3] = ["m", "mm", "um"];

impl Rig {
    /// The built-in system of this rig; none for a model file and what is only reduced.
    pub fn pendulum(&self) -> Option<Pendulum> {
        Pendulum::named(&self.model)
    }

    /// The error for a model that has no equations to work with: a name that is not in the list, or
    /// one of a system that is only reduced.
    pub fn no_such_model(&self) -> BadInput {
        let names = MODELS.iter().map(|m| m.0).chain(library::all().iter().map(|l| l.0));
        let meant = did_you_mean(&self.model, names);
        let only = if crate::reduce::systems::by_id(&self.model).is_some() {
            ", which `whirl reduce` alone takes"
        } else {
            ""
        };
        let built_in: Vec<&str> = MODELS.iter().map(|m| m.0).collect();
        let expected =
            format!("{}, another system of `whirl list models`, or the path of a model file", built_in.join(", "));
        BadInput::new(format!("\"{}\"{only}", self.model), expected)
            .in_file(&self.path)
            .at("model")
            .remedy(format!("{meant}Correct the name; the path of a model file ends in .toml"))
    }

    /// Whether a coefficient or quantity that is called as one of a pendulum's is that: of a built-in
    /// pendulum, or of a file whose bodies hang on `arm1`. What else a file calls `a` or `m1` is its
    /// own.
    pub fn names_a_pendulum_s(&self, name: &str) -> bool {
        // Amplitude and phase are a drive's.
        let is_there = self.drive.is_some() || !["a", "psi"].contains(&name);
        let Some(bound) = &self.bound else { return is_there && self.pendulum().is_some() };
        let file = bound.model.mechanism.as_deref().and_then(|m| m.file.as_deref());
        let arm = |b: &Placed<Body>| matches!(&b.value, Body::Arm { name, .. } if name == "arm1");
        is_there && file.is_some_and(|f| !f.written && f.bodies.iter().any(arm))
    }
}

/// A model file with its output equation: what the rig's channels measure of it, y = S q.
#[derive(Clone, Debug, PartialEq)]
pub struct ObservedModel {
    /// The model.
    pub model: Arc<ModelFile>,
    /// Channels that measure coordinates, in the rig's order.
    pub sensors: Vec<usize>,
    /// S: row r says what sensor r measures, in the model's coordinates.
    pub shown: DMatrix<f64>,
    /// S⁻¹.
    pub coordinates: DMatrix<f64>,
    /// Which coordinates channels show as angles: on the circle, and on the line, as of a shaft whose
    /// spring winds up over turns.
    pub angles: Vec<bool>,
    /// Channel of each input.
    pub inputs: Vec<usize>,
    /// Which of the inputs is the base's acceleration, where a channel shows that or its position.
    pub base: Option<usize>,
}

impl ObservedModel {
    /// Refuses to simulate an input that a channel shows as the base's position.
    ///
    /// # Errors
    /// It is one.
    pub fn refuse_base_position(&self, rig: &Rig, input: usize, remedy: &str) -> Result<()> {
        let channel = &rig.channel[self.inputs[input]];
        if self.base != Some(input) || channel.unit == ACCELERATION {
            return Ok(());
        }
        let expected = format!("unit \"{ACCELERATION}\" for a base that is simulated");
        Err(BadInput::new(format!("unit \"{}\"", channel.unit), expected)
            .in_file(&rig.path)
            .at(format!("channel \"{}\"", channel.name))
            .remedy(remedy))
    }
}

/// Refuses a channel of the base that is neither a position nor an acceleration.
fn check_base(rig: &Rig) -> Result<()> {
    let channel = rig.channel.iter().enumerate().find(|(_, c)| c.measures == BASE);
    let Some((i, c)) = channel else { return Ok(()) };
    if c.unit == ACCELERATION || POSITIONS.contains(&c.unit.as_str()) {
        return Ok(());
    }
    let expected = format!("{}, or {ACCELERATION} for an accelerometer", POSITIONS.join(", "));
    Err(BadInput::new(format!("\"{}\"", c.unit), expected)
        .in_file(&rig.path)
        .at(format!("channel {} (\"{}\"), unit", i + 1, c.name))
        .remedy("The base's motion is a position or an acceleration; counts take gain, the unit's worth of one"))
}

impl Rig {
    /// The channel that shows the base's own motion.
    pub fn base(&self) -> Option<usize> {
        self.channel.iter().position(|c| c.measures == BASE)
    }

    /// Channels that measure inputs, what moves the system from outside, rather than coordinates.
    pub fn inputs(&self) -> Vec<usize> {
        match &self.bound {
            Some(bound) => bound.inputs.clone(),
            None => self.pendulum().and_then(|_| self.base()).into_iter().collect(),
        }
    }
}

/// Refuses a channel of a built-in system that measures something else.
pub(super) fn check_built_in(rig: &Rig) -> Result<()> {
    let Some(mut known) = rig.pendulum().map(Pendulum::measures) else { return Ok(()) };
    known.push(BASE);
    check_base(rig)?;
    match rig.channel.iter().enumerate().find(|(_, c)| !known.contains(&c.measures.as_str())) {
        None => {
            let mut arms = rig.channel.iter().enumerate().filter(|(_, c)| c.measures != BASE);
            let model = Path::new(&rig.model);
            arms.try_for_each(|(i, c)| declared::check(rig, i, &c.measures, &Declared::angle(), model))
        }
        Some((i, c)) => Err(BadInput::new(format!("\"{}\"", c.measures), format!("one of {}", known.join(", ")))
            .in_file(&rig.path)
            .at(format!("channel {} (\"{}\"), measures", i + 1, c.name))
            .remedy("Correct what the channel measures of this model")),
    }
}

/// Whether a rig's model is a file: its own, or one of the program's systems. What is built in
/// keeps its name.
pub(super) fn is_file(model: &str) -> bool {
    let built_in = Pendulum::named(model).is_some() || crate::reduce::systems::by_id(model).is_some();
    model_file::is_path(model) || (!built_in && library::text(model).is_some())
}

/// Reads the model file that a rig names and checks its channels against it; none for a built-in
/// model.
pub(super) fn bind(rig: &Rig) -> Result<Option<Arc<ObservedModel>>> {
    if !is_file(&rig.model) {
        return Ok(None);
    }
    let source = source(rig)?;
    let model = system::model_of(source, rig.nominal.as_deref(), rig.omega()).map_err(|e| e.in_file(&rig.path))?;
    known(rig, &model)?;
    bound(rig, model).map(|b| Some(Arc::new(b)))
}

/// The text of the model that a rig names.
fn source(rig: &Rig) -> Result<Source> {
    if let (false, Some(text)) = (model_file::is_path(&rig.model), library::text(&rig.model)) {
        return Ok(Source { text: text.to_owned(), path: Path::new(&rig.model).to_path_buf() });
    }
    let path = rig.path.parent().unwrap_or(Path::new("")).join(&rig.model);
    // A file that ships with the program needs no copy beside the rig file.
    if let (false, Some(text)) = (path.exists(), rig.model.strip_suffix(".toml").and_then(library::text)) {
        return Ok(Source { text: text.to_owned(), path: Path::new(&rig.model).to_path_buf() });
    }
    if !path.exists() {
        return Err(BadInput::new(
            format!("\"{}\", which does not exist", rig.model),
            "a model, or the path of a model file",
        )
        .in_file(&rig.path)
        .at("model")
        .remedy("The path is relative to the rig file; `whirl list models` shows the built-in ones"));
    }
    toml_place::read(&path, "a model file")
}

/// Whether a model's input of the base's name is an acceleration, as its system file says.
fn accelerates(model: &ModelFile) -> bool {
    let file = model.mechanism.as_ref().and_then(|m| m.file.as_deref());
    file.is_some_and(|file| {
        let k = file.words.inputs.iter().position(|name| name == BASE);
        k.and_then(|k| file.input_units.get(k)).is_some_and(|unit| *unit == Unit::of_channel(ACCELERATION))
    })
}

/// Refuses known quantities that the model does not have.
fn known(rig: &Rig, model: &ModelFile) -> Result<()> {
    let Some(mechanism) = &model.mechanism else { return super::check_known(&rig.known, &rig.path) };
    let names = mechanism.known_names();
    match rig.known.iter().find(|(k, v)| *k != "g" && !(names.contains(&k.as_str()) && v.is_finite())) {
        None => {
            let values = rig.known.iter().map(|(k, v)| (k.as_str(), *v));
            possible::check((&rig.path, &rig.text), "known", mechanism, values)
        }
        Some((k, v)) => {
            let (found, expected) = if names.contains(&k.as_str()) {
                (v.to_string(), "a finite number".to_owned())
            } else {
                ("an unknown quantity".to_owned(), format!("one of {}", names.join(", ")))
            };
            Err(BadInput::new(found, expected)
                .in_file(&rig.path)
                .at(format!("known.{k}"))
                .remedy("What may be known are the system's own parameters and quantities"))
        }
    }
}

pub(crate) fn bound(rig: &Rig, model: ModelFile) -> Result<ObservedModel> {
    let n = model.coordinates.len();
    let names =
        Names { coordinates: model.coordinates.iter().map(|c| c.name.clone()).collect(), inputs: model.inputs.clone() };
    let sensors_of = model.mechanism.as_ref().map_or(&[][..], |m| &m.sensors);
    let named = names.coordinates.iter().chain(&names.inputs).chain(sensors_of.iter().map(|s| &s.name));
    let mut known: Vec<&str> = named.map(String::as_str).collect();
    known.dedup();
    let (coordinate_units, input_units) = declared::of_model(&model);
    let (mut sensors, mut rows, mut inputs) = (Vec::new(), Vec::new(), vec![None; model.inputs.len()]);
    for (i, c) in rig.channel.iter().enumerate() {
        let bad = |found: String, expected: String| {
            BadInput::new(found, expected)
                .in_file(&rig.path)
                .at(format!("channel {} (\"{}\"), measures", i + 1, c.name))
                .remedy(format!("Name a coordinate or an input of {}", model.source.path.display()))
        };
        let sensor = sensors_of.iter().find(|s| s.name == c.measures);
        let e = parse(sensor.map_or(c.measures.as_str(), |s| &s.shows), &names).map_err(|m| {
            let found = if names.coordinates.contains(&c.measures) { m.found } else { format!("\"{}\"", c.measures) };
            bad(found, format!("one of {}", known.join(", ")))
        })?;
        if let Some(k) = model.inputs.iter().position(|u| *u == c.measures) {
            inputs[k] = Some(i);
            // The base's position is made an acceleration of.
            if let Some(d) = input_units[k].as_ref().filter(|_| c.measures != BASE || !accelerates(&model)) {
                declared::check(rig, i, &c.measures, d, &model.source.path)?;
            }
            continue;
        }
        let row: Option<Vec<f64>> =
            (0..n).map(|k| e.derivative(Symbol::Coordinate(k)).and_then(|d| as_number(&d))).collect();
        let linear = row.filter(|r| {
            let value = e.value(&|s| if let Symbol::Coordinate(k) = s { 1.7 + k as f64 } else { f64::NAN });
            let sum: f64 = r.iter().enumerate().map(|(k, f)| f * (1.7 + k as f64)).sum();
            (value - sum).abs() < 1e-9 && r.iter().any(|f| *f != 0.0)
        });
        let Some(row) = linear else {
            return Err(bad(
                format!("\"{}\"", c.measures),
                "a coordinate, a sum of coordinates, or an input".to_owned(),
            ));
        };
        // A number in front may have a unit itself, as that of a pulley.
        for (k, d) in coordinate_units.iter().enumerate().filter(|(k, _)| row[*k].abs() == 1.0) {
            let name = &names.coordinates[k];
            d.iter().try_for_each(|d| declared::check(rig, i, name, d, &model.source.path))?;
        }
        sensors.push(i);
        rows.push(row);
    }
    let channels = |found: String, expected: String| {
        BadInput::new(found, expected)
            .in_file(&rig.path)
            .at("channel")
            .remedy("Each coordinate and input needs a channel")
    };
    if let Some(k) = inputs.iter().position(Option::is_none) {
        return Err(channels(format!("no channel that measures {}", model.inputs[k]), "one for each input".to_owned()));
    }
    if let Some(k) = (0..n).find(|&k| rows.iter().all(|r| r[k] == 0.0)) {
        let name = &model.coordinates[k].name;
        return Err(channels(format!("no channel that measures {name}"), "one for each coordinate".to_owned()));
    }
    if rows.len() != n {
        return Err(channels(
            format!("{} channels for {n} coordinates", rows.len()),
            "one for each coordinate".to_owned(),
        ));
    }
    let shown = DMatrix::from_fn(n, n, |r, k| rows[r][k]);
    let Some(coordinates) = shown.clone().try_inverse() else {
        return Err(channels("channels that measure the same".to_owned(), "one for each coordinate".to_owned()));
    };
    if rig.drive.is_none() && model.uses_phase() {
        return Err(BadInput::new("no [drive], and a model that uses tau", "the drive whose phase tau is")
            .in_file(&rig.path)
            .at("drive")
            .remedy("Add [drive] with its direction and frequency_hz"));
    }
    let base = model.inputs.iter().position(|u| u == BASE).filter(|_| accelerates(&model));
    if base.is_some() {
        check_base(rig)?;
    }
    let inputs = inputs.into_iter().flatten().collect();
    let turns = |r: usize| matches!(rig.channel[sensors[r]].unit.as_str(), "count" | "rad" | "deg");
    let is_angle = |k: usize| (0..sensors.len()).any(|r| shown[(r, k)] != 0.0 && turns(r));
    let angles = (0..model.coordinates.len()).map(is_angle).collect();
    Ok(ObservedModel { model: Arc::new(model), sensors, shown, coordinates, angles, inputs, base })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_that_is_misspelt_is_told_the_name_that_was_meant() {
        let mut rig = Rig::of_columns(&[], crate::record::names::TimeChoice::default());
        rig.model = "double-pendulm".to_owned();
        let e = rig.no_such_model().to_string();
        assert!(e.contains("Did you mean double-pendulum?") && e.contains("`whirl list models`"), "{e}");
    }

    const MODEL: &str = r#"name = "m"
coordinates = [{ name = "a", space = "S1" }, { name = "b", space = "S1" }]
inputs = ["u"]
[[equation]]
balance = "u"
terms = { x = "a''", y = "b''" }
"#;

    fn rig(measures: [&str; 3]) -> Result<Rig> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("m.toml"), MODEL).unwrap();
        let channels: String = measures
            .iter()
            .enumerate()
            .map(|(i, m)| format!("[[channel]]\nname = \"c{i}\"\nmeasures = \"{m}\"\nunit = \"1\"\n"))
            .collect();
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, format!("name = \"r\"\nmodel = \"m.toml\"\nsample_rate_hz = 100.0\n{channels}")).unwrap();
        Rig::read(&path)
    }

    #[test]
    fn relative_encoders_are_sums_of_coordinates() {
        let b = rig(["u", "a", "b - a"]).unwrap().bound.unwrap();
        assert_eq!((b.sensors.as_slice(), b.inputs.as_slice()), (&[1, 2][..], &[0][..]));
        assert_eq!(b.shown, DMatrix::from_row_slice(2, 2, &[1.0, 0.0, -1.0, 1.0]));
        assert_eq!(b.coordinates, DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 1.0, 1.0]));
    }

    #[test]
    fn channels_that_do_not_fit_are_named() {
        for (measures, part) in [
            (["u", "a", "c"], "channel 3 (\"c2\"), measures: found \"c\", expected one of a, b, u"),
            (["u", "a", "a*b"], "a sum of coordinates"),
            (["u", "a", "2*a"], "no channel that measures b"),
            (["a", "b", "a - b"], "no channel that measures u"),
            (["u", "a - b", "b - a"], "the same"),
            (["u", "a'", "b"], "measures"),
        ] {
            let message = rig(measures).unwrap_err().to_string();
            assert!(message.contains(part), "{measures:?}: {message}");
        }
    }
}
