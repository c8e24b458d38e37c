//! Units of coefficients, from those of the channels.

use crate::model::model_file::ModelFile;
use crate::model::model_file::units::{self, Unit};
use crate::rig::Rig;
use crate::rig::measures::ObservedModel;

/// Units of the coordinates and of the inputs, from those of the channels.
pub fn channel_units(model: &ModelFile, rig: &Rig, bound: &ObservedModel) -> (Vec<Unit>, Vec<Unit>) {
    let coordinates = (0..model.coordinates.len())
        .map(|k| {
            let row = (0..bound.sensors.len()).find(|&r| bound.shown[(r, k)] != 0.0).unwrap_or(0);
            Unit::of_channel(rig.channel[bound.sensors[row]].si_unit())
        })
        .collect();
    let inputs = bound.inputs.iter().enumerate().map(|(k, &i)| {
        // A position of the base has been differentiated twice.
        let unit = if bound.base == Some(k) { "m/s2" } else { rig.channel[i].si_unit() };
        Unit::of_channel(unit)
    });
    (coordinates, inputs.collect())
}

/// Units of a model file's coefficients; one for each term, equation by equation.
pub fn units_of(model: &ModelFile, rig: &Rig, bound: &ObservedModel) -> Vec<Vec<String>> {
    let (coordinates, inputs) = channel_units(model, rig, bound);
    let seconds = model.prime_scale(rig.omega()) == 1.0;
    model
        .equations
        .iter()
        .map(|e| {
            e.terms.iter().map(|t| units::coefficient(&e.balance, &t.of, &coordinates, &inputs, seconds)).collect()
        })
        .collect()
}
