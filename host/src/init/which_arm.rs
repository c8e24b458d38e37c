//! Which column shows which arm of a double pendulum: what the equations of motion say, and where
//! they do not tell, what the columns are called or how they stand in the file.

use super::look::Tried;
use super::system::arm;
use super::{Draft, DraftChannel, Statement};
use crate::record::names;
use crate::wording::format::{shell_word, significant};

/// By how much less the best reading must leave, in ln(residual/noise power).
pub(super) const CLEARLY: f64 = 0.15;

/// Words for the arm at the pivot, and for the one that hangs from it.
const FIRST: [&str; 9] = ["1", "upper", "inner", "first", "proximal", "ober", "innen", "erst", "oben"];
const SECOND: [&str; 9] = ["2", "lower", "outer", "second", "distal", "unter", "äußer", "zweit", "unten"];

/// Which of the two columns shows arm 1.
pub(super) struct Order {
    /// Index of it.
    first: usize,
    /// Whether the columns' names say so; it is their order in the file otherwise.
    by_name: bool,
}

impl Order {
    /// As the columns' names say it, or as they stand.
    pub fn of(draft: &Draft) -> Self {
        let arms: Vec<Option<u8>> = draft.channels.iter().map(|c| arm_of(&c.name)).collect();
        match arms[..] {
            [Some(1), Some(2)] => Self { first: 0, by_name: true },
            [Some(2), Some(1)] => Self { first: 1, by_name: true },
            _ => Self { first: 0, by_name: false },
        }
    }

    /// Whether a reading is so.
    pub fn is_of(&self, draft: &Draft) -> bool {
        draft.channels.get(self.first).is_some_and(|c| c.measures.ends_with('1'))
    }

    /// Puts the first reading of this order first where the equations do not tell: where it leaves
    /// nearly as little, or where none fits and the names say so.
    pub fn put_first(&self, tried: &mut [Tried], fits: bool) {
        let Some(k) = tried.iter().position(|t| self.is_of(&t.draft)) else { return };
        if tried[k].left - tried[0].left <= CLEARLY || !fits && self.by_name {
            tried[..=k].rotate_right(1);
        }
    }

    /// Why it is taken.
    pub fn why(&self) -> &'static str {
        if self.by_name { "the columns are called so" } else { "the columns stand in this order" }
    }
}

/// The arm that a column's name says; none where it says none, or both.
fn arm_of(column: &str) -> Option<u8> {
    let base = names::split(column).0.to_lowercase();
    let mut words: Vec<&str> = base.split(|c: char| !c.is_alphanumeric()).collect();
    // `theta1`, `enc2`.
    let digits = base.split(|c: char| !c.is_ascii_digit()).filter(|w| !w.is_empty());
    words.extend(digits);
    let says =
        |list: &[&str]| words.iter().any(|w| list.iter().any(|l| w == l || l.chars().count() > 2 && w.starts_with(l)));
    match (says(&FIRST), says(&SECOND)) {
        (true, false) => Some(1),
        (false, true) => Some(2),
        _ => None,
    }
}

/// What the columns' names say that they measure of two arms; none where not all of them do.
pub(super) fn said(draft: &Draft) -> Option<[&'static str; 2]> {
    match &draft.channels[..] {
        [a, b] => match (arm(&a.name)?, arm(&b.name)?) {
            (first @ ("theta1" | "phi1"), second @ ("theta2" | "phi2")) => Some([first, second]),
            _ => None,
        },
        _ => None,
    }
}

pub(super) fn measuring(draft: &Draft, order: &[&str]) -> Draft {
    let mut d = draft.clone();
    d.channels.iter_mut().zip(order).for_each(|(c, m)| c.measures = (*m).to_owned());
    d
}

pub(super) fn beside(by: f64) -> String {
    if by.is_finite() {
        return format!("every other leaves at least {} times the residual", significant((by / 2.0).exp(), 3));
    }
    "no other fits".to_owned()
}

/// Which column shows what in a reading, and the options that say so.
pub(super) fn otherwise(draft: &Draft) -> String {
    let each = |text: &dyn Fn(&DraftChannel) -> String| draft.channels.iter().map(text).collect::<Vec<_>>();
    let columns = each(&|c| format!("{} as {}", c.name, c.measures)).join(" and ");
    let options = each(&|c| format!("--map {}={}", c.measures, shell_word(&c.name))).join(" ");
    format!("{columns} ({options})")
}

/// What is told beside which column shows which arm.
pub(super) struct Beside {
    /// The next best reading.
    pub rival: String,
    /// Whether names say all of it, theta1 and phi2.
    pub by_name: bool,
    /// Why this order of the arms was taken, where it is that of names or the file.
    pub order: Option<&'static str>,
}

/// Tells which column shows which arm; the next best reading leaves `by` more, in ln(power).
pub(super) fn tell_measures(draft: &mut Draft, by: f64, is_founded: bool, beside_it: &Beside) {
    let Beside { rival, by_name, order } = beside_it;
    let by_name = *by_name;
    for c in &mut draft.channels {
        let what = match c.measures.as_str() {
            "theta1" | "phi1" => "the angle of arm 1",
            "theta2" => "the angle of arm 2 relative to arm 1",
            _ => "the absolute angle of arm 2",
        };
        c.why.push(if by_name && (!is_founded || by <= 0.0) {
            Statement::new(&c.name, what, "its name says so")
        } else if by <= CLEARLY {
            let order = order.map(|why| format!("{why}; ")).unwrap_or_default();
            let drive = if is_founded { "" } else { "; if a shaker runs, say it with --drive-hz HZ" };
            let nearly = if by < -CLEARLY { "fit better, yet not to the noise," } else { "fit nearly as well" };
            let why = format!("{order}the equations of motion {nearly} with {rival}{drive}");
            Statement::new(&c.name, what, why).unsure()
        } else if !is_founded {
            let why = "the equations of motion without a drive leave least so, yet do not fit; say the drive with --drive-hz HZ, or which column is which with --map theta1=COLUMN --map theta2=COLUMN";
            Statement::new(&c.name, what, why).unsure()
        } else {
            Statement::new(&c.name, what, format!("the equations of motion fit so; {}", beside(by)))
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::tests::{channel_of, draft_of};

    fn two(names: [&str; 2]) -> Draft {
        draft_of(names.into_iter().map(channel_of).collect())
    }

    #[test]
    fn names_tell_the_arms_and_otherwise_their_order_does() {
        for (names, first, by_name) in [
            (["Upper arm (deg)", "Lower arm (deg)"], 0, true),
            (["Lower arm", "Upper arm"], 1, true),
            (["outer", "inner"], 1, true),
            (["Unterer Arm", "Oberer Arm"], 1, true),
            (["enc2", "enc1"], 1, true),
            (["second_link", "first_link"], 1, true),
            (["a", "b"], 0, false),
            (["arm 1", "arm 1 again"], 0, false),
            (["enc12", "enc34"], 0, false),
        ] {
            let order = Order::of(&two(names));
            assert_eq!((order.first, order.by_name), (first, by_name), "{names:?}");
        }
    }

    #[test]
    fn the_order_decides_between_readings_that_fit_alike() {
        let draft = two(["Upper arm", "Lower arm"]);
        let tried = |left: f64| {
            vec![
                Tried { draft: measuring(&draft, &["phi2", "phi1"]), left: 0.9 },
                Tried { draft: measuring(&draft, &["phi1", "phi2"]), left },
            ]
        };
        let taken = |left: f64, fits: bool| {
            let mut tried = tried(left);
            Order::of(&draft).put_first(&mut tried, fits);
            tried[0].draft.channels[0].measures.clone()
        };
        assert_eq!(
            (taken(1.0, true).as_str(), taken(2.0, true).as_str(), taken(2.0, false).as_str()),
            ("phi1", "phi2", "phi1")
        );
        let mut told = measuring(&draft, &["phi1", "phi2"]);
        let order = Some(Order::of(&draft).why());
        let rival = otherwise(&measuring(&draft, &["phi2", "phi1"]));
        tell_measures(&mut told, -0.1, true, &Beside { rival, by_name: false, order });
        let why = &told.channels[0].why[0];
        assert!(
            why.check
                && why.why.starts_with(
                    "the columns are called so; the equations of motion fit nearly as well with Upper arm as phi2"
                ),
            "{why:?}"
        );
    }
}
