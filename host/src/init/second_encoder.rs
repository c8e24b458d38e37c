//! A second encoder that says nothing of itself: whole numbers beside an angle that one arm alone
//! does not explain.

use super::columns::{Seen, extent};
use super::raw::Raw;
use super::{Draft, Settings, Statement, of_system};
use crate::system::library::Pendulum;

/// A column of whole numbers that may be the other arm's counts.
struct Other<'a> {
    name: &'a str,
    /// Least and greatest of its numbers.
    ends: [f64; 2],
}

/// Takes a record for one of two arms where the equations of one fit no reading of its one angle,
/// whole numbers stand beside it, and the equations of two fit both. Where those fit neither, the
/// draft says what the other column may be.
pub(super) fn reconsider(draft: &mut Draft, raw: &Raw, seen: &[Seen], settings: &Settings) {
    let Some(other) = other_of(draft, raw, seen, settings) else { return };
    let system = Some(Pendulum::Double.id().to_owned());
    let two = of_system(raw, seen, &Settings { system, ..settings.clone() });
    let Ok((mut of_two, Some(fits))) = two else { return };
    if fits {
        let angle = draft.channels.first().map_or("", |c| c.name.as_str());
        let why = format!(
            "the equations of motion of one arm fit no reading of {angle}, those of two arms fit {angle} and {}; another system is told by --system",
            other.name
        );
        of_two.why_model.insert(0, Statement::new("model", Pendulum::Double.id(), why));
        *draft = of_two;
        return;
    }
    tell(draft, &other);
}

/// The one column of whole numbers beside the angle of a single pendulum that nobody asked for.
fn other_of<'a>(draft: &Draft, raw: &Raw, seen: &'a [Seen], settings: &Settings) -> Option<Other<'a>> {
    let is_guess = settings.system.is_none() && settings.choices.map.is_empty();
    let is_counted = draft.channels.len() == 1 && draft.channels[0].unit == "count";
    if !(is_guess && is_counted && draft.pendulum() == Some(Pendulum::Single)) {
        return None;
    }
    let mut others = seen.iter().filter(|s| s.may_count && s.name != draft.channels[0].name);
    let (Some(s), None) = (others.next(), others.next()) else { return None };
    let e = extent(&raw.values(s.index));
    Some(Other { name: &s.name, ends: [e.low, e.high] })
}

/// Says what the other column may be, where the model is told as one that fits nothing.
fn tell(draft: &mut Draft, other: &Other) {
    let Other { name, ends: [low, high] } = other;
    let text = format!(
        "{name}, whole numbers from {low} to {high}, looks like the encoder of a second arm, yet the equations of two arms do not fit to the sensors' noise either; where it is one, say --system {}",
        Pendulum::Double.id()
    );
    let model = draft.model.clone().unwrap_or_default();
    draft.why_model.push(Statement::new("model", model, text).unsure());
}

#[cfg(test)]
mod tests {
    use super::super::tests::{channel_of, draft_of};
    use super::*;

    #[test]
    fn the_other_column_is_told_with_its_numbers_and_the_option() {
        let mut draft = draft_of(vec![channel_of("right")]);
        tell(&mut draft, &Other { name: "left", ends: [-705.0, 603.0] });
        let told = draft.why_model.last().unwrap();
        assert!(told.check, "{told:?}");
        for part in ["left, whole numbers from -705 to 603", "second arm", "--system double-pendulum"] {
            assert!(told.why.contains(part), "{}", told.why);
        }
    }
}
