//! The checks' findings in words: one warning a channel and a kind, with the first rows named, and
//! all of them (up to [`MOST`]) as numbers.

use serde_json::Value;

use super::Numbering;
use super::breaks::Found;
use super::cut::is_limit;
use super::frozen::Run;
use super::mending::Mending;
use super::row_steps;
use super::slipped::Step;
use super::sorting::Event;
use super::stuck_bit::{self, Stuck};
use super::trace::Trace;
use crate::record::Record;
use crate::rig::Rig;
use crate::warning::Warning;
use crate::wording::format::rounded;

/// Rows that are listed as numbers.
const MOST: usize = 100;
/// Rows that are named in a text.
const NAMED: usize = 3;

/// What is needed to put a finding into words: the record's names, rows and times.
pub struct Wording<'a> {
    record: &'a Record,
    numbering: &'a Numbering,
    /// Whether equations are identified from the record.
    equations: bool,
    /// Whether the drive's phase follows from the rows' times alone.
    clocked: bool,
}

impl<'a> Wording<'a> {
    pub fn new(record: &'a Record, rig: &Rig, numbering: &'a Numbering) -> Self {
        let clocked = rig.drive.is_some() && record.segments.iter().any(|s| s.phase.is_none());
        Self { record, numbering, equations: rig.bound.is_some() || rig.model.ends_with("pendulum"), clocked }
    }

    fn name(&self, channel: usize) -> &str {
        &self.record.channels[channel].name
    }

    fn unit(&self, channel: usize, value: f64) -> String {
        match self.record.channels[channel].unit.as_str() {
            "count" => format!(" count{}", if value.abs() == 1.0 { "" } else { "s" }),
            "1" => String::new(),
            unit => format!(" {unit}"),
        }
    }

    fn row(&self, segment: usize, sample: usize) -> u64 {
        self.numbering.place(segment, sample)
    }

    fn time(&self, segment: usize, sample: usize) -> f64 {
        // Times are known to the sample; digits beyond that say nothing.
        (self.record.segments[segment].time(sample) * 1e6).round() / 1e6
    }

    fn at(&self, segment: usize, sample: usize) -> String {
        format!("{} {} (t = {} s)", self.numbering.word, self.row(segment, sample), self.time(segment, sample))
    }

    /// A warning with its first place.
    fn placed(&self, w: Warning, channel: Option<usize>, (segment, sample): (usize, usize)) -> Warning {
        let w = w.with("row", self.row(segment, sample)).with("time_s", self.time(segment, sample));
        match channel {
            Some(k) => w.with("channel", self.name(k)),
            None => w,
        }
    }

    /// A channel that does not move; `nothing_moves`: nor does any other.
    pub fn dead(&self, channel: usize, value: f64, nothing_moves: bool) -> Warning {
        let name = self.name(channel);
        let why = if nothing_moves {
            "no measured channel moves, so that the rig is at rest or its sensors are dead"
        } else {
            "its sensor is dead, or what it measures is held fast"
        };
        let w = Warning::new(
            "dead-channel",
            format!("{name} stays at {} over the whole record: {why}", rounded(value, 6)),
            "Check the sensor, its cable and its supply, and record again; the motion cannot be told from this record",
        );
        let w = self.placed(w, Some(channel), (0, 0)).with("value", value);
        if self.equations { w.invalidating() } else { w }
    }

    /// A channel that is renewed at every n-th sample.
    pub fn held(&self, channel: usize, n: usize) -> Warning {
        let (name, hz) = (self.name(channel), self.record.sample_rate_hz / n as f64);
        let rate = rounded(hz, 6);
        let w = Warning::new(
            "held-samples",
            format!(
                "{name} is renewed at every {} {} only ({rate} Hz) and held in between",
                ordinal(n),
                self.numbering.word
            ),
            format!(
                "Held samples are late by up to {}: record at {rate} Hz, or keep only the rows at which {name} is new and set sample_rate_hz to that",
                if n == 2 { "a step".to_owned() } else { format!("{} steps", n - 1) }
            ),
        );
        self.placed(w, Some(channel), (0, 0)).with("value", n).with("rate_hz", hz).invalidating()
    }

    /// Stuck bits of a channel.
    pub fn stuck(&self, channel: usize, stuck: &[Stuck]) -> Option<Warning> {
        let name = self.name(channel);
        let wrong: Vec<&Stuck> = stuck.iter().filter(|s| !s.coarse).collect();
        let constant: Vec<String> = stuck.iter().map(|s| format!("bit {} is always {}", s.bit, s.value)).collect();
        let bits: Vec<Value> = stuck.iter().map(|s| Value::from(s.bit)).collect();
        let first = wrong.first().copied().or(stuck.first())?;
        let text = format!("in the counts of {name} {}", constant.join(", "));
        let w = if wrong.is_empty() {
            let step = 1u64 << stuck.len();
            Warning::new(
                "stuck-bit",
                format!("{text}: it moves in steps of {step} counts"),
                format!(
                    "Each step is taken for the middle of its {step} counts ({:+} counts on the whole channel); the record stands, but coarser than its counts say: look at the counter's lines, or at how the column was made",
                    stuck_bit::coarse(stuck).map_or(0.0, |s| s.middle() - 0.5)
                ),
            )
        } else {
            Warning::new(
                "stuck-bit",
                format!("{text}: half of its values are wrong by {} counts", 1u64 << first.bit),
                "Look at the counter's lines and at how the column was made, and record again",
            )
            .invalidating()
        };
        Some(self.placed(w, Some(channel), (0, 0)).with("value", first.value).with("bits", bits))
    }

    /// Rows missing or doubled all over the record.
    pub fn rows(&self, id: &'static str, found: &row_steps::Found) -> Warning {
        let (segment, sample) = found.first;
        let share = 100.0 * found.rows as f64 / found.looked_at.max(1) as f64;
        let what = if id == "rows-missing" {
            "rows are missing although t goes on evenly"
        } else {
            "rows are there twice, under times of their own"
        };
        let w = Warning::new(
            id,
            format!(
                "{what}: in {share:.1} % of the places where the motion is fast enough to tell ({} of {}), first at {}",
                found.rows,
                found.looked_at,
                self.at(segment, sample)
            ),
            "Times that were numbered anew hide what was lost: export the record with the times at which the samples were taken",
        );
        self.placed(w, None, found.first).with("value", found.rows).invalidating()
    }

    /// Runs in which a channel stands: what is clipped and what has stopped is left out.
    pub fn runs(&self, channel: usize, runs: &[Run], trace: &Trace<'_>, mending: &mut Mending) -> Vec<Warning> {
        let mut warnings = Vec::new();
        for sign in [1, -1] {
            let of: Vec<&Run> = runs.iter().filter(|r| r.extreme == sign).collect();
            if is_limit(&of) {
                warnings.push(self.clipped(channel, &of, trace, mending));
            }
        }
        let clipped =
            |r: &Run| r.extreme != 0 && is_limit(&runs.iter().filter(|o| o.extreme == r.extreme).collect::<Vec<_>>());
        for run in runs.iter().filter(|r| !clipped(r)) {
            mending.leave_out(run.stretch, run.from, run.to);
            if let Some(end) = run.filled_to {
                warnings.push(self.filled(channel, run, end));
                continue;
            }
            let name = self.name(channel);
            let (from, n) = (self.at(run.stretch, run.from), run.to - run.from);
            let text = match (run.open, run.from) {
                (true, 0) => format!(
                    "{name} stays at {} until {} and is then in full motion: its sensor was not alive",
                    run.value,
                    self.at(run.stretch, run.to)
                ),
                (true, _) => format!(
                    "{name} stops at {from} in the middle of a motion and stays at {}: its sensor has died",
                    run.value
                ),
                _ => format!(
                    "{name} stops at {from} in the middle of a motion and stays at {} for {n} rows: its sensor was away",
                    run.value
                ),
            };
            let place = if run.open && run.from == 0 { run.to } else { run.from };
            let w = Warning::new(
                "channel-stopped",
                text,
                format!("These {n} rows are left out as a gap; look at the sensor's cable and supply"),
            );
            warnings
                .push(self.placed(w, Some(channel), (run.stretch, place)).with("value", run.value).with("left_out", n));
        }
        warnings
    }

    /// A straight line without the noise of the channel.
    fn filled(&self, channel: usize, run: &Run, end: f64) -> Warning {
        let (name, n) = (self.name(channel), run.to - run.from);
        let unit = self.unit(channel, end);
        let [from, to] = [run.value, end].map(|v| rounded(v, 6));
        let w = Warning::new(
            "filled-in",
            format!(
                "{name} goes along a straight line without its noise for {n} rows, from {from}{unit} at {} to {to}{unit} at {}: its values were filled in there",
                self.at(run.stretch, run.from),
                self.at(run.stretch, run.to - 1)
            ),
            format!("These {n} rows are left out as a gap; leave cells empty where the sensor gave nothing"),
        );
        self.placed(w, Some(channel), (run.stretch, run.from)).with("value", run.value).with("left_out", n)
    }

    fn clipped(&self, channel: usize, runs: &[&Run], trace: &Trace<'_>, mending: &mut Mending) -> Warning {
        let (value, name) = (runs[0].value, self.name(channel));
        let mut left_out = 0;
        for (stretch, s) in trace.stretches.iter().enumerate() {
            let mut from = None;
            for i in 0..=s.len() {
                match (i < s.len() && s.at(i) == value, from) {
                    (true, None) => from = Some(i),
                    (false, Some(first)) => {
                        mending.leave_out(stretch, first, i);
                        left_out += i - first;
                        from = None;
                    }
                    _ => {}
                }
            }
        }
        let place = self.at(runs[0].stretch, runs[0].from);
        let how = match runs {
            [once] => format!("for {} rows, reached in full motion, from {place} on", once.to - once.from),
            _ => format!("{} times, in the middle of a motion, first at {place}", runs.len()),
        };
        let w = Warning::new(
            "clipped",
            format!("{name} is cut off at {value}{}: it stands there {how}", self.unit(channel, value)),
            format!("These {left_out} rows are left out as gaps; give the sensor or the counter a wider range"),
        );
        self.placed(w, Some(channel), (runs[0].stretch, runs[0].from)).with("value", value).with("left_out", left_out)
    }

    /// Spikes, rows and records joined, `channels` being those that were looked at; slips of their
    /// channels are left for [`super::slipped`] to tell.
    pub fn breaks(
        &self,
        channels: &[usize],
        events: &[Event],
        mending: &mut Mending,
        slipped: &mut Vec<(usize, Step)>,
    ) -> Vec<Warning> {
        let mut warnings = Vec::new();
        for (i, &k) in channels.iter().enumerate() {
            let of = |wanted: fn(&Event) -> Option<(usize, Found)>| -> Vec<Found> {
                events.iter().filter_map(wanted).filter(|(c, _)| *c == i).map(|(_, f)| f).collect()
            };
            let spikes = of(|e| if let Event::Spike(k, f) = e { Some((*k, *f)) } else { None });
            let slips = of(|e| if let Event::Slip(k, f) = e { Some((*k, *f)) } else { None });
            for f in &spikes {
                mending.leave_out(f.stretch, f.from, f.to);
            }
            for f in &slips {
                mending.take_back(k, f.stretch, f.from, f.size);
                slipped.push((k, self.step(k, f)));
            }
            if let Some(first) = spikes.first() {
                let left_out: usize = spikes.iter().map(|f| f.to - f.from).sum();
                let text = format!(
                    "{} {} off what the motion around {} allows: {}",
                    self.name(k),
                    if spikes.len() == 1 {
                        "has a sample".to_owned()
                    } else {
                        format!("has samples at {} places", spikes.len())
                    },
                    if spikes.len() == 1 { "it" } else { "them" },
                    self.list(k, &spikes)
                );
                let rows = if left_out == 1 {
                    "This row is left out as a gap".to_owned()
                } else {
                    format!("These {left_out} rows are left out as gaps")
                };
                let w = Warning::new(
                    "spike",
                    text,
                    format!("{rows}; look for a typing error, or for disturbances on the sensor's line"),
                );
                warnings.push(self.listed(w, k, first, &spikes).with("left_out", left_out));
            }
        }
        warnings.extend(self.all_channels(events, mending));
        warnings
    }

    /// What happened to all channels at once.
    fn all_channels(&self, events: &[Event], mending: &mut Mending) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let rows = |m: bool| {
            events.iter().filter_map(move |e| match e {
                Event::Rows(n, s, at) if (*n > 0) == m => Some((*s, *at, *n)),
                _ => None,
            })
        };
        let joined = events.iter().filter_map(|e| if let Event::Joined(s, at) = e { Some((*s, *at, 0)) } else { None });
        let groups = [
            (
                "rows-missing",
                "a row is missing although t goes on evenly",
                "rows are missing although t goes on evenly",
                rows(true).collect::<Vec<(usize, usize, i64)>>(),
            ),
            (
                "rows-doubled",
                "a row is there twice, under a time of its own",
                "rows are there twice, under times of their own",
                rows(false).collect(),
            ),
            (
                "record-joined",
                "value and velocity of the channels leap at one row: another record, or another part of it, goes on there",
                "value and velocity of the channels leap: other records, or other parts of it, go on there",
                joined.collect(),
            ),
        ];
        for (id, one, many, places) in groups {
            let Some(&(segment, sample, n)) = places.first() else { continue };
            places.iter().for_each(|&(s, at, _)| mending.split(s, at));
            let what = if places.len() == 1 && n < 2 { one } else { many };
            let list: Vec<String> = places.iter().take(NAMED).map(|&(s, at, _)| self.at(s, at)).collect();
            let more =
                if places.len() > NAMED { format!(" and {} more places", places.len() - NAMED) } else { String::new() };
            let advice = if self.clocked {
                "The drive's phase is not known behind it: split the file there, and give each part its own times"
            } else {
                "The record is split there; give the parts as records of their own"
            };
            let w = Warning::new(id, format!("{what}: {}{more}", list.join(", ")), advice);
            let numbers: Vec<Value> =
                places.iter().take(MOST).map(|&(s, at, _)| Value::from(self.row(s, at))).collect();
            let w = self.placed(w, None, (segment, sample)).with("value", places.len()).with("rows", numbers);
            warnings.push(if self.clocked { w.invalidating() } else { w });
        }
        warnings
    }

    /// The first places of a channel with their sizes.
    fn list(&self, channel: usize, found: &[Found]) -> String {
        let one = |f: &Found| {
            let size = self.size(channel, f);
            format!("{} by {size:+}{}", self.at(f.stretch, f.from), self.unit(channel, size))
        };
        let list: Vec<String> = found.iter().take(NAMED).map(one).collect();
        let more = if found.len() > NAMED { format!(" and {} more", found.len() - NAMED) } else { String::new() };
        format!("{}{more}", list.join(", "))
    }

    /// A slip as it is told.
    fn step(&self, channel: usize, f: &Found) -> Step {
        let (row, time_s) = (self.row(f.stretch, f.from), self.time(f.stretch, f.from));
        Step { row: Some(row), time_s, size: self.size(channel, f), near: false }
    }

    /// A size: whole counts, or so many digits as its error has.
    fn size(&self, channel: usize, f: &Found) -> f64 {
        if self.record.channels[channel].unit == "count" {
            return f.size.round();
        }
        format!("{:.3e}", f.size).parse().unwrap_or(f.size)
    }

    fn listed(&self, w: Warning, channel: usize, first: &Found, found: &[Found]) -> Warning {
        let numbers = |of: &dyn Fn(&Found) -> Value| found.iter().take(MOST).map(of).collect::<Vec<Value>>();
        self.placed(w, Some(channel), (first.stretch, first.from))
            .with("value", self.size(channel, first))
            .with("rows", numbers(&|f| self.row(f.stretch, f.from).into()))
            .with("sizes", numbers(&|f| self.size(channel, f).into()))
    }
}

fn ordinal(n: usize) -> String {
    match n {
        2 => "second".to_owned(),
        3 => "third".to_owned(),
        n => format!("{n}th"),
    }
}
