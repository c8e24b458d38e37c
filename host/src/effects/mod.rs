//! The catalogue of physical effects that a system may have or miss: entries of `effects.toml`, and
//! of a user's own files.
//!
//! An entry says how an effect acts, by one of six verbs: `force` does work at a joint, between two
//! coordinates or at an arm, `drags` all along an arm or at a mass at a point, `moves` displaces the
//! driven point or all that a frame carries, `advances` the drive's phase, `turns` a body's
//! centroid or gravity, `reads` is what an encoder shows. Its strengths enter linearly; shape
//! parameters (the order of cogging, the velocity of Stribeck's law) are tried on a grid. What an entry adds to the equations of a system derived
//! from bodies is in [`columns`]. `docs/effects.md` is the user's page.
//!
//! | file | what |
//! |---|---|
//! | [`entry`] | an entry, read and checked |
//! | [`states`] | internal states of an effect |
//! | [`kinds`] | what kind of effect a law is: of a position, one that brakes |
//! | [`value`] | strengths to what is reported |
//! | [`places`] | where a system has joints, pairs of coordinates, arms, masses at points, a drive, a frame, encoders |
//! | [`put_in`] | effects of a simulation |
//! | [`columns`] | what an effect of strength one adds to every equation |
//! | [`along_an_arm`] | the same for a force per length along an arm |
//! | [`at_a_point`] | the same for a force along the velocity of a mass at a point |
//! | [`on_a_record`] | what is added to sensors and to records of inputs, put on and taken off |
//! | [`on_a_frame`] | the same for a frame that gives way |
//! | `turned` | a centroid off its line, gravity in a frame that leans |
//! | `own_spring` | a law at a place where the system has a spring of its own |
//! | [`between`] | pairs of coordinates, and forces between the two |
//! | [`written`] | the same for equations that a user wrote down |

pub mod along_an_arm;
pub mod at_a_point;
pub mod between;
pub mod changes;
pub mod columns;
pub mod entry;
pub mod kinds;
pub mod on_a_frame;
pub mod on_a_record;
mod own_spring;
pub mod places;
pub mod put_in;
pub mod states;
mod turned;
pub mod value;
pub mod written;

use std::path::Path;
use std::sync::OnceLock;

use self::entry::Entry;
use crate::error::Result;
use crate::model::model_file::toml_place::Source;

/// The text of the catalogue.
pub const TEXT: &str = include_str!("effects.toml");

/// What is known of the one effect that is no law at a place of a system, so that `explain` cannot
/// have it: every coefficient is as another system's.
const TIME_BASE: &str = "id = \"time-base\"
at = \"frame\"
unit = \"1\"
equation = \"a second of the record's t lasts 1 + s seconds\"
signature = \"none in residuals: quantities under [known] contradict the record by one factor of time, which `whirl identify` tells\"
confirm = \"record for ten minutes by a watch and compare with the record's t\"
# For `whirl simulate` of the built-in pendulums.";

/// The text of one entry of the catalogue, up to the empty line behind it.
pub fn text_of(id: &str) -> Option<String> {
    if id == "time-base" {
        return Some(TIME_BASE.to_owned());
    }
    let first = format!("id = \"{id}\"");
    let entry: Vec<&str> = TEXT.lines().skip_while(|l| *l != first).take_while(|l| !l.is_empty()).collect();
    (!entry.is_empty()).then(|| entry.join("\n"))
}

/// The catalogue.
///
/// # Panics
/// Never: the embedded file is read in a test.
pub fn catalogue() -> &'static [Entry] {
    static ENTRIES: OnceLock<Vec<Entry>> = OnceLock::new();
    ENTRIES.get_or_init(|| {
        let source = Source { text: TEXT.to_owned(), path: Path::new("effects.toml").to_path_buf() };
        read(&source).unwrap_or_default()
    })
}

/// Entries of the catalogue's text.
fn read(source: &Source) -> Result<Vec<Entry>> {
    entry::read(source)
}

/// Entries of an effect file, which stand beside the catalogue and those of `more` files.
///
/// # Errors
/// Names file, line and column, what was found and what was expected.
pub fn read_more<'a>(source: &Source, more: impl Iterator<Item = &'a Entry>) -> Result<Vec<Entry>> {
    entry::read_beside(source, catalogue().iter().chain(more))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::entry::At;

    #[test]
    fn the_catalogue_is_read_whole() {
        let source = Source { text: TEXT.to_owned(), path: Path::new("effects.toml").to_path_buf() };
        let all = entry::read_beside(&source, core::iter::empty()).unwrap();
        assert_eq!(all.len(), TEXT.matches("[[effect]]").count());
        assert_eq!(all.len(), catalogue().len());
        let told = |t: String| t.contains("\nconfirm = ") || t.contains("\nsame_as = ");
        assert!(all.iter().all(|e| text_of(&e.id).is_some_and(told)));
        assert!(all.iter().all(|e| e.takes_from.is_none() || e.positive[0]));
    }

    /// What may be of a length is not told in the words of an angle.
    #[test]
    fn texts_hold_for_angles_and_lengths() {
        let of_both = |e: &&Entry| !e.turning && !e.names(columns::LOAD) && matches!(e.at, At::Joint | At::Encoder);
        for e in catalogue().iter().filter(of_both) {
            let text = format!("{}; {}", e.signature, e.confirm);
            let mut words = text.split(|c: char| !c.is_alphabetic());
            assert!(
                !words.any(|w| ["arm", "encoder", "encoders", "angle", "bearing"].contains(&w)),
                "{}: {text}",
                e.id
            );
            assert!(!text.contains("turn the joint") && !text.contains("a torque gauge"), "{}: {text}", e.id);
        }
    }

    /// A refinement steps by shares of the value, and a power of 0, 1 or 2 is another entry.
    #[test]
    fn grids_hold_neither_zero_where_they_are_refined_nor_other_laws() {
        let mut refined = 0;
        for (e, k) in catalogue().iter().flat_map(|e| e.bounded_shapes().map(move |k| (e, k))) {
            assert!(!e.shapes[k].grid.contains(&0.0), "{} {}", e.id, e.shapes[k].name);
            refined += 1;
        }
        assert!(refined >= 6, "{refined}");
        let power = catalogue().iter().find(|e| e.id == "power-law-damping").unwrap();
        assert!(power.shapes[0].grid.iter().all(|p| ![0.0, 1.0, 2.0].contains(p)), "{power:?}");
    }
}
