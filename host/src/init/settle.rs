//! What the equations of motion decide: of all readings of a record, the one that they fit.
//!
//! Counts a turn, radians or degrees, whether angles are relative or absolute, which column is
//! which arm and of which frequency a drive is all leave the equations a residual where they are
//! wrong ([`crate::identify::suspects`]). Where two readings fit alike, nothing is decided and the
//! statement is one to check.

use super::columns::{self, Seen, UNITS};
use super::counts::likely;
use super::look::{Look, Tried};
use super::meant;
use super::which_arm::{Beside, CLEARLY, Order, beside, measuring, otherwise, said, tell_measures};
use super::{Draft, DraftChannel, DraftDrive, Settings, Statement};
use crate::error::{BadInput, Result};
use crate::identify::suspects::{self, Footing};
use crate::inspect::motion;
use crate::record::Record;
use crate::record::cut::Part;
use crate::rig::{Direction, Rig};
use crate::system::library::Pendulum;
use crate::wording::format::significant;

/// Seconds that are looked at of a free system; drive periods of a driven one.
const FREE_S: f64 = 40.0;
const PERIODS: f64 = 200.0;
/// Drive periods of the slowest drive that is possible.
const FEW_PERIODS: f64 = 60.0;
/// By how much less a reading with a drive must leave than all without, in ln(residual/noise
/// power): ten times less power.
const DRIVEN: f64 = 2.3;
/// The same where no more is left than a third above the noise's power: a drive that is none takes
/// something away, yet not all of what equations miss. A short record of a fast motion shows no more
/// of its drive (both by hand).
const TO_NOISE: f64 = 0.7;
const NOISE: f64 = 0.3;
/// The same of a drive's frequency, half the residual (by hand): terms at a line of the motion take
/// something away wherever it is, and where the equations lack an effect a wrong one takes as much.
const CLEAR_LINE: f64 = 1.4;

/// Residual over noise power, ln, up to which the equations fit: a factor of 4.
const FITS: f64 = 1.4;
/// The same up to which a free motion does: twice the noise's power; clean records of free swings
/// leave half of that.
const FREE: f64 = 0.7;
/// Counts a turn of common encoders: others are told only where the equations of motion fit.
const COMMON: core::ops::RangeInclusive<u32> = 400..=131_072;
/// Other frequencies that are named beside a guess.
const NAMED: usize = 3;

/// Drives that are possible.
pub(super) struct Possible<'a> {
    /// Those at lines of the motion.
    pub lines: &'a [DraftDrive],
    /// Whether there may be one without a line.
    pub may_hide: bool,
}

/// Settles what the equations tell; a drive is one of those that are possible, or none. Whether
/// they fit to the sensors' noise is returned, where a reading could be looked at.
pub(super) fn settle(
    draft: &mut Draft,
    seen: &[Seen],
    settings: &Settings,
    possible: &Possible,
) -> Result<Option<bool>> {
    let Possible { lines: possible, may_hide } = *possible;
    let rig = readable(draft, possible)?;
    let mut record = Record::read(&draft.record, &rig, &settings.options)?;
    let start = record.segments.first().map_or(0.0, |s| s.start_s);
    let slowest = possible.iter().map(|d| d.frequency_hz).fold(f64::INFINITY, f64::min);
    let length = draft.drive.as_ref().map_or(FREE_S.max(FEW_PERIODS / slowest), |d| PERIODS / d.frequency_hz);
    // Without a bound that fits, all of it is looked at.
    let _ = record.cut(&Part { from_s: None, to_s: Some(start + length) });
    let open = Open::of(draft, seen);
    let span_s = record.segments.iter().map(|s| s.len() as f64 * s.step_s).fold(0.0, f64::max);
    let Some(on) = Footing::of(&record, &rig) else { return Ok(None) };
    let look = Look { record: &record, on, span_s };
    let mut tried = look.at_all(readings(draft, &open, settings, possible));
    if tried.is_empty() {
        return Ok(None);
    }
    if may_hide && (tried[0].left > FITS || tried[0].draft.drive.is_none()) {
        look.beside_the_lines(&mut tried, &readings(draft, &open, settings, &[]));
    }
    let mut is_founded = true;
    // A drive adds terms, which take something away even where there is none.
    let at_rest = tried.iter().find(|t| t.draft.drive.is_none()).map_or(f64::INFINITY, |t| t.left);
    let is_noise = tried[0].left < NOISE;
    if at_rest - tried[0].left < if is_noise { TO_NOISE } else { DRIVEN } {
        tried.retain(|t| t.draft.drive.is_none());
        if may_hide && draft.pendulum().is_some() && at_rest > FREE {
            // A free motion would die away; one that repeats after the drive's periods says nothing
            // of its frequency.
            let grows_less = grows_less(&record);
            let motion = if grows_less { "grows less, and" } else { "does not die away, yet" };
            let why = format!(
                "the motion {motion} the equations of motion ask for no frequency clearly; if a shaker runs, say it with --drive-hz HZ, otherwise --drive-hz 0"
            );
            tried.iter_mut().for_each(|t| t.draft.why_model.push(Statement::new("drive", "none", &why).unsure()));
            // What leaves least of readings that all lack the drive is no better founded than that.
            is_founded = grows_less && at_rest <= FITS;
        }
    }
    let said = said(draft).filter(|_| draft.pendulum() == Some(Pendulum::Double) && settings.choices.map.is_empty());
    let as_said = |d: &Draft| said.is_some_and(|said| d.channels.iter().zip(said).all(|(c, m)| c.measures == m));
    // Equations that fit no reading say nothing against a name.
    if (!is_founded || tried[0].left > FITS)
        && let Some(k) = tried.iter().position(|t| as_said(&t.draft))
    {
        tried[..=k].rotate_right(1);
    }
    let fits = is_founded && tried[0].left <= FITS;
    let is_arms = draft.pendulum() == Some(Pendulum::Double) && settings.choices.map.is_empty();
    let order = is_arms.then(|| Order::of(draft));
    if let Some(order) = &order {
        order.put_first(&mut tried, fits);
    }
    let best = tried[0].draft.clone();
    let left = tried[0].left;
    let next = |differs: &dyn Fn(&Draft) -> bool| {
        tried.iter().find(|t| differs(&t.draft)).map_or(f64::INFINITY, |t| t.left) - left
    };
    let differs =
        |d: &Draft, k: usize, what: &dyn Fn(&DraftChannel) -> String| what(&d.channels[k]) != what(&best.channels[k]);
    let counts = next(&|d| open.counts.iter().any(|k| differs(d, *k, &|c| format!("{:?}", c.counts_per_turn))));
    let units: Vec<f64> = open.units.iter().map(|k| next(&|d| differs(d, *k, &|c| c.unit.clone()))).collect();
    let measures_otherwise = |d: &Draft| d.channels.iter().zip(&best.channels).any(|(a, b)| a.measures != b.measures);
    let measures = next(&measures_otherwise);
    let rival = tried.iter().find(|t| measures_otherwise(&t.draft)).map(|t| otherwise(&t.draft)).unwrap_or_default();
    let other = |d: &Draft| match (frequency(d), frequency(&best)) {
        (Some(a), Some(b)) => !look.one_line(a, b),
        (a, b) => a.is_some() != b.is_some(),
    };
    let of_line = next(&other);
    let is_guess = of_line.is_finite() && of_line <= CLEAR_LINE || of_line.is_infinite() && left > FITS;
    let rivals = rivals(&tried, &other, left, &look);
    let found_here = draft.drive.is_none();
    *draft = best;
    let founded = |by: f64| if is_founded { by } else { 0.0 };
    tell_all_counts(draft, &open, founded(counts), fits, settings);
    for (k, by) in open.units.iter().zip(units) {
        tell_unit(&mut draft.channels[*k], founded(by));
    }
    if measures.is_finite() {
        let by_name = said.is_some() && as_said(draft);
        let order = order.filter(|o| o.is_of(draft)).map(|o| o.why());
        tell_measures(draft, measures, is_founded, &Beside { rival, by_name, order });
    }
    if of_line.is_finite() || found_here && is_guess {
        tell_drive(draft, of_line, is_guess, &rivals);
    }
    refine(draft, &record, settings.drive_hz.is_some());
    Ok(Some(left <= FITS))
}

/// Whether every angle's span in the last sixth of the record is below half of that in the first: a
/// driven motion may grow less too, so that this says less than
/// [`crate::inspect::standing_line::dies_away`].
fn grows_less(record: &Record) -> bool {
    let span = |part: &[f64]| {
        let ends = part.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
        ends.1 - ends.0
    };
    let mut all = motion::motions(record).into_iter().flat_map(|m| m.stretches.into_iter().max_by_key(Vec::len));
    all.all(|x| {
        let part = x.len() / 6;
        part > 1 && span(&x[x.len() - part..]) < 0.5 * span(&x[..part])
    })
}

/// The draft as a rig, with one of the possible drives where its equations have a drive in them.
fn readable(draft: &Draft, possible: &[DraftDrive]) -> Result<Rig> {
    let with = |drive: &DraftDrive| Draft { drive: Some(drive.clone()), ..draft.clone() }.rig();
    draft.rig().or_else(|e| {
        if let Some(rig) = possible.iter().find_map(|d| with(d).ok()) {
            return Ok(rig);
        }
        let any = DraftDrive { direction: Direction::Vertical, frequency_hz: 1.0, why: Vec::new() };
        if draft.drive.is_some() || with(&any).is_err() {
            return Err(e);
        }
        let found = "equations with a drive in them, and a motion in which no drive shows: no line that stands over the whole record";
        Err(BadInput::new(found, "a record of a motion that is driven all the time")
            .in_file(&draft.record)
            .at("drive")
            .remedy("Leave --system out, and add model and [drive] to the rig file that is written"))
    })
}

fn frequency(draft: &Draft) -> Option<f64> {
    draft.drive.as_ref().map(|d| d.frequency_hz)
}

/// Channels of which the columns leave something open.
struct Open {
    /// The counts a turn.
    counts: Vec<usize>,
    /// Radians or degrees.
    units: Vec<usize>,
}

impl Open {
    /// Channels whose unit is open, those together that are called alike: they have one.
    fn alike(&self, draft: &Draft) -> Vec<Vec<usize>> {
        let mut out: Vec<Vec<usize>> = Vec::new();
        for k in &self.units {
            let name = |k: usize| draft.channels[k].name.as_str();
            match out.iter_mut().find(|group| columns::alike(name(group[0]), name(*k))) {
                Some(group) => group.push(*k),
                None => out.push(vec![*k]),
            }
        }
        out
    }

    fn of(draft: &Draft, seen: &[Seen]) -> Self {
        let all = |is_open: &dyn Fn(&Seen) -> bool| {
            let of = |c: &DraftChannel| seen.iter().any(|s| s.name == c.name && is_open(s));
            (0..draft.channels.len()).filter(|k| of(&draft.channels[*k])).collect()
        };
        Self { counts: all(&|s| s.unit == "count" && s.counts.is_none()), units: all(&|s| s.is_unit_open) }
    }
}

/// All readings that are possible.
fn readings(draft: &Draft, open: &Open, settings: &Settings, possible: &[DraftDrive]) -> Vec<Draft> {
    let mut out = vec![draft.clone()];
    if draft.pendulum() == Some(Pendulum::Double) && settings.choices.map.is_empty() {
        let orders = [["theta1", "theta2"], ["phi1", "phi2"], ["theta2", "theta1"], ["phi2", "phi1"]];
        // Columns that are called after the arms are not exchanged.
        let possible = if said(draft).is_some() { &orders[..2] } else { &orders[..] };
        out = possible.iter().map(|order| measuring(draft, order)).collect();
    }
    let drives = possible.iter().flat_map(|d| drives_of(draft, d)).map(Some).chain([draft.drive.clone()]);
    let with_drive =
        |drive: Option<DraftDrive>| out.iter().map(|d| Draft { drive: drive.clone(), ..d.clone() }).collect::<Vec<_>>();
    out = drives.flat_map(with_drive).collect();
    for group in open.alike(draft) {
        let each = |d: &Draft| UNITS.map(|unit| in_unit(d, &group, unit));
        out = out.iter().flat_map(each).collect();
    }
    if open.counts.is_empty() {
        return out;
    }
    let with = |d: &Draft, n: u32| {
        let mut d = d.clone();
        open.counts.iter().for_each(|k| d.channels[*k].counts_per_turn = Some(n));
        d
    };
    out.iter()
        .flat_map(|d| likely().into_iter().filter(|n| *n >= 200).map(|n| with(d, n)).collect::<Vec<_>>())
        .collect()
}

/// A drive that is possible, or what else makes its line: a motion goes to and fro once in a period
/// of a horizontal drive, or in two of a vertical one.
fn drives_of(draft: &Draft, d: &DraftDrive) -> Vec<DraftDrive> {
    if d.direction == Direction::Vertical {
        return vec![d.clone()];
    }
    let drive = |direction, times: f64| DraftDrive { direction, frequency_hz: times * d.frequency_hz, ..d.clone() };
    // The double pendulum's equations have a vertical drive only.
    let possible = draft.pendulum().is_none_or(|p| p.takes(d.direction));
    let once = if possible { d.direction } else { Direction::Vertical };
    vec![drive(once, 1.0), drive(Direction::Vertical, 2.0)]
}

fn in_unit(draft: &Draft, group: &[usize], unit: &str) -> Draft {
    let mut d = draft.clone();
    group.iter().for_each(|k| unit.clone_into(&mut d.channels[*k].unit));
    d
}

/// Frequencies that leave so little more that they may be the drive's as well.
fn rivals(tried: &[Tried], other: &dyn Fn(&Draft) -> bool, left: f64, look: &Look) -> Vec<f64> {
    let mut out: Vec<f64> = Vec::new();
    for t in tried.iter().filter(|t| t.left - left <= CLEAR_LINE && other(&t.draft)) {
        let Some(hz) = frequency(&t.draft) else { continue };
        if out.len() < NAMED && !out.iter().any(|f| look.one_line(*f, hz)) {
            out.push(hz);
        }
    }
    out
}

fn tell_counts(c: &mut DraftChannel, by: f64) {
    let n = c.counts_per_turn.unwrap_or_default();
    c.why.retain(|w| !w.check);
    let text = format!("{n} counts a turn");
    c.why.push(if by > CLEARLY {
        Statement::new(&c.name, text, format!("the equations of motion fit with them; {}", beside(by)))
    } else {
        Statement::new(
            &c.name,
            text,
            "the equations of motion fit nearly as well with others: see the encoder's data sheet",
        )
        .unsure()
    });
}

/// Tells the counts a turn that are open, and that another system may be meant where none fits.
fn tell_all_counts(draft: &mut Draft, open: &Open, by: f64, fits: bool, settings: &Settings) {
    for k in &open.counts {
        let c = &mut draft.channels[*k];
        // Numbers at the ends of those that are tried fit what has another system's equations.
        let is_common = c.counts_per_turn.is_some_and(|n| COMMON.contains(&n));
        match (is_common, fits) {
            (false, false) => meant::common_counts(c),
            (false, true) => {
                let text = format!("{} counts a turn", c.counts_per_turn.unwrap_or_default());
                let why = "the equations of motion fit with them, but few encoders have so many or so few, and another system may be meant: see the encoder's data sheet";
                c.why.retain(|w| !w.check);
                c.why.push(Statement::new(&c.name, text, why).unsure());
            }
            (true, _) => tell_counts(c, by),
        }
    }
    if !fits && settings.system.is_none() && !open.counts.is_empty() {
        let why = "its equations of motion fit no reading of these columns to the sensors' noise; another system is told by --system, `whirl list models` lists them";
        let model = draft.model.clone().unwrap_or_default();
        draft.why_model.push(Statement::new("model", model, why).unsure());
    }
}

fn tell_unit(c: &mut DraftChannel, by: f64) {
    c.why.retain(|w| !w.check);
    let text = format!("an angle in {}", c.unit);
    c.why.push(if by > CLEARLY {
        Statement::new(
            &c.name,
            text,
            format!("its name says an angle, the equations of motion its unit; {}", beside(by)),
        )
    } else {
        let why = "its name says an angle; the equations of motion fit nearly as well with the other of rad and deg";
        Statement::new(&c.name, text, why).unsure()
    });
}

fn tell_drive(draft: &mut Draft, by: f64, is_guess: bool, rivals: &[f64]) {
    let Some(d) = &mut draft.drive else { return };
    let text = format!("{} Hz", d.frequency_hz);
    let set = "say what the generator or the strobe shows with --drive-hz";
    d.why.push(if !is_guess {
        Statement::new("drive", text, format!("the equations of motion fit so; {}", beside(by)))
    } else if rivals.is_empty() {
        Statement::new("drive", text, format!("a guess: the equations of motion do not fit well with it; {set}"))
            .unsure()
    } else {
        let list: Vec<String> = rivals.iter().map(|hz| format!("{} Hz", significant(*hz, 5))).collect();
        let list = list.join(", ");
        Statement::new("drive", text, format!("a guess: the equations of motion fit nearly as well with {list}; {set}"))
            .unsure()
    });
}

/// What the equations say of the finished reading: the drive's direction and a frequency that is
/// off.
fn refine(draft: &mut Draft, record: &Record, is_told: bool) {
    let Ok(rig) = draft.rig() else { return };
    let record = Record { channels: rig.channel.clone(), ..record.clone() };
    for w in suspects::examine(core::slice::from_ref(&record), &rig) {
        let Some(d) = &mut draft.drive else { return };
        if w.id == "drive-direction" && rig.pendulum().is_some_and(|p| p.takes(Direction::Horizontal)) {
            d.direction = if d.direction == Direction::Vertical { Direction::Horizontal } else { Direction::Vertical };
            d.why.retain(|s| !s.check);
            let name = if d.direction == Direction::Vertical { "vertical" } else { "horizontal" };
            d.why.push(Statement::new(
                "drive",
                name,
                "the equations of motion show the drive's force in that direction",
            ));
        } else if !is_told
            && let ("drive-frequency", Some(hz)) = (w.id, w.details.get("value_hz").and_then(serde_json::Value::as_f64))
        {
            let error = w.details.get("std_error_hz").and_then(serde_json::Value::as_f64).unwrap_or(0.0);
            d.frequency_hz = super::raw::nice(hz, (2.0 * error / hz).max(1e-9));
            d.why.push(Statement::new(
                "drive",
                format!("{} Hz", d.frequency_hz),
                "the equations of motion fit best with it",
            ));
        }
    }
    // A vertical drive is the only one that the double pendulum's equations have.
    if rig.pendulum().is_some_and(|p| !p.takes(Direction::Horizontal))
        && let Some(d) = &mut draft.drive
    {
        d.why.retain(|s| !s.check);
        let why = "the double pendulum's equations have no other; one that moves sideways needs a model file";
        d.why.push(Statement::new("drive", "vertical", why).unsure());
    }
}
