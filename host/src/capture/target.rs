//! What a capture asks of the shaker, by its options and the rig file.

use super::drive::Target;
use super::{CaptureSettings, excite};
use crate::error::{BadInput, Result};
use crate::rig::Rig;
use crate::rig::measures::BASE;
use crate::warning::Warning;

/// What cannot be done with a record whose drive is no sine.
pub(super) fn needs_measured_base(target: Option<Target>, rig: &Rig) -> Option<Warning> {
    let excitation = target?.0;
    if excitation.is_sine() || rig.channel.iter().any(|c| c.measures == BASE) {
        return None;
    }
    Some(Warning::new(
        "base-not-measured",
        format!("the base was commanded {}, and no channel measures it", excite::words(&excitation)),
        "`whirl identify` takes a drive that is not measured for one sine: add a channel with measures = \"base\" to the rig \
         file, or capture with one frequency",
    ))
}

/// What the shaker is to do; none where the rig has no drive or its amplitude is not known.
pub(super) fn target(settings: &CaptureSettings, rig: &Rig) -> Result<Option<Target>> {
    let Some(drive) = rig.drive.filter(|_| settings.drive) else {
        let asked = settings.excite.is_asked();
        let of_drive = settings.amplitude_m.map(|a| format!("--amplitude-m {a}"));
        let of_drive = of_drive.or(asked.then(|| settings.excite.options().join(" ")));
        return match of_drive.filter(|_| settings.drive || asked) {
            Some(option) if settings.drive => Err(BadInput::new(option, "a rig with [drive]")
                .in_file(&rig.path)
                .at("drive")
                .remedy("Add [drive] with direction and frequency_hz to the rig file")),
            Some(option) => Err(BadInput::new(format!("{option} with --no-drive"), "one of them")
                .at("--no-drive")
                .remedy("Leave one of them out")),
            None => Ok(None),
        };
    };
    let first_step = settings.excite.amplitude_steps_m.first().copied();
    let table = settings.excite.table()?;
    // A table has an amplitude of its own.
    let own = table.map(|table| table.peak_m).or(drive.amplitude_m);
    let amplitude = settings.amplitude_m.or(first_step).or(own);
    let amplitude = match (amplitude, settings.from.split(':').next()) {
        (None, Some("sim")) => Some(crate::rig::plant::Plant::of(rig)?.amplitude_m),
        (amplitude, _) => amplitude,
    };
    let Some(amplitude) = amplitude else { return Ok(None) };
    let millihertz = drive.frequency_hz * 1e3;
    if (millihertz - millihertz.round()).abs() > 1e-6 || !(1.0..=4e9).contains(&millihertz) {
        return Err(BadInput::new(
            drive.frequency_hz.to_string(),
            "a frequency in steps of 0.001 Hz, which the device takes",
        )
        .in_file(&rig.path)
        .at("drive.frequency_hz")
        .remedy(format!("Set {:.3}", drive.frequency_hz)));
    }
    if !(0.0..=2.0).contains(&amplitude) {
        return Err(BadInput::new(amplitude.to_string(), "an amplitude in metres, 0 to 2")
            .in_file(&rig.path)
            .at("drive.amplitude_m")
            .remedy("Give it in metres"));
    }
    // Both are within 32 bits, see above.
    let (micrometre, millihertz) = ((amplitude * 1e6).round() as u32, millihertz.round() as u32);
    let mut excitation = settings.excite.excitation(micrometre, millihertz)?;
    if let Some(table) = table {
        table.put_into(&mut excitation);
    }
    Ok(Some(Target(excitation, table.map(|table| table.table))))
}
