//! First light: each arm is turned by hand, and what its encoder says of it is put into words.
//!
//! An arm that hangs, is turned and hangs again has turned by whole turns. So the counts between
//! two rests say what a turn is, up to where friction holds the arm: [`SLACK_DEG`].

/// How far from its lowest point friction may hold an arm, degrees.
const SLACK_DEG: f64 = 10.0;
/// How long an arm is still before it counts as at rest, s.
const REST_S: f64 = 0.7;
/// Counts by which an encoder trembles about an edge while its arm hangs still.
const TREMBLE: i64 = 3;

/// What one encoder has done.
#[derive(Clone, Debug, Default)]
pub(super) struct Turning {
    /// Counts since the first, not wrapped, and the count that came last.
    total: i64,
    last: Option<(i32, u32)>,
    /// Where the mark is.
    mark: i64,
    /// Least and greatest since the arm moved last, and since which tick.
    still: Option<(i64, i64, u32)>,
    rest: Option<i64>,
    /// Counts between the last two rests.
    pub(super) between_rests: Option<i64>,
    /// Least and greatest since the mark.
    reach: (i64, i64),
    /// Counts in the last 0.1 s or so, with its sign.
    pub(super) motion: f64,
}

impl Turning {
    /// Takes a sample.
    pub(super) fn take(&mut self, count: i32, tick: u32, rate_hz: f64) {
        let (moved, ticks) = match self.last {
            None => (0, 1),
            Some((last, at)) => (i64::from(count.wrapping_sub(last)), tick.wrapping_sub(at)),
        };
        self.last = Some((count, tick));
        self.total += moved;
        let kept = (-f64::from(ticks) / (0.1 * rate_hz)).exp();
        // Counts are far below 2⁵³.
        self.motion = self.motion * kept + moved as f64;
        self.reach = (self.reach.0.min(self.total), self.reach.1.max(self.total));
        let (least, greatest, since) = self.still.unwrap_or((self.total, self.total, tick));
        let (least, greatest) = (least.min(self.total), greatest.max(self.total));
        if greatest - least > TREMBLE {
            self.still = Some((self.total, self.total, tick));
            return;
        }
        self.still = Some((least, greatest, since));
        if f64::from(tick.wrapping_sub(since)) > REST_S * rate_hz {
            let now = i64::midpoint(least, greatest);
            match self.rest {
                Some(before) if (now - before).abs() > 2 * TREMBLE => {
                    self.between_rests = Some(now - before);
                    self.rest = Some(now);
                }
                Some(_) => {}
                None => self.rest = Some(now),
            }
        }
    }

    /// Counts since the mark.
    pub(super) fn since_mark(&self) -> i64 {
        self.total - self.mark
    }

    /// Least and greatest since the mark.
    pub(super) fn reach(&self) -> (i64, i64) {
        (self.reach.0 - self.mark, self.reach.1 - self.mark)
    }

    /// Counts anew from here.
    pub(super) fn set_mark(&mut self) {
        self.mark = self.total;
        self.reach = (self.total, self.total);
        self.between_rests = None;
    }

    /// The direction in which it counts now.
    pub(super) fn direction(&self) -> &'static str {
        match self.motion {
            m if m > 2.0 => "▲ counts up (+)",
            m if m < -2.0 => "▼ counts down (−)",
            _ => "■ still",
        }
    }
}

/// What the counts between two rests say of the counts of a turn.
pub(super) fn judged(between: Option<i64>, counts_per_turn: u32) -> String {
    let Some(counts) = between else {
        return "not seen yet: hang, turn once, let hang".to_owned();
    };
    // Far below 2⁵³.
    let turns = counts as f64 / f64::from(counts_per_turn);
    let whole = turns.round();
    let off = 360.0 * (turns - whole).abs();
    match () {
        () if off <= SLACK_DEG && whole.abs() == 1.0 => {
            format!("one whole turn, {off:.0}° off: {counts_per_turn} a turn fits")
        }
        () if off <= SLACK_DEG && whole == 0.0 => "came back to where it hung before: no turn".to_owned(),
        () if off <= SLACK_DEG => {
            format!("{} turns; if it was one, counts_per_turn is {}", whole.abs(), counts.abs())
        }
        () => format!("{:.2} turns; if it was one, counts_per_turn is {}", turns.abs(), counts.abs()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turned from rest to rest by so many counts, at 100 Hz.
    fn turned(turning: &mut Turning, tick: &mut u32, from: i32, by: i32) -> i32 {
        for i in 0..100 {
            *tick = tick.wrapping_add(1);
            turning.take(from + i % 2, *tick, 100.0);
        }
        for i in 1..=100 {
            *tick = tick.wrapping_add(1);
            turning.take(from + by * i / 100, *tick, 100.0);
        }
        from + by
    }

    #[test]
    fn a_turn_from_rest_to_rest_is_judged() {
        let (mut turning, mut tick) = (Turning::default(), u32::MAX - 50);
        assert!(judged(turning.between_rests, 4096).contains("not seen yet"));
        let at = turned(&mut turning, &mut tick, i32::MAX - 1_000, 0);
        let at = turned(&mut turning, &mut tick, at, 4_090 - 4_090);
        assert_eq!(turning.between_rests, None);
        // Across the wrap of the counter.
        let mut wrapped = at;
        for _ in 0..100 {
            tick = tick.wrapping_add(1);
            wrapped = wrapped.wrapping_add(41);
            turning.take(wrapped, tick, 100.0);
        }
        assert_eq!(turning.direction(), "▲ counts up (+)");
        turned(&mut turning, &mut tick, wrapped, 0);
        assert_eq!(turning.direction(), "■ still");
        let between = turning.between_rests.unwrap();
        assert!((4_096..=4_104).contains(&between), "{between}");
        assert_eq!(judged(Some(between), 4096), "one whole turn, 0° off: 4096 a turn fits");
        assert!((4_095..=4_105).contains(&turning.since_mark()) && turning.reach().0 == 0);
        turning.set_mark();
        assert_eq!((turning.since_mark(), turning.reach(), turning.between_rests), (0, (0, 0), None));
    }

    #[test]
    fn wrong_counts_of_a_turn_are_told() {
        for (between, part) in [
            (-4_100, "one whole turn, 0° off: 4096 a turn fits"),
            (1_024, "0.25 turns; if it was one, counts_per_turn is 1024"),
            (-8_192, "2 turns; if it was one, counts_per_turn is 8192"),
            (60, "no turn"),
        ] {
            assert!(judged(Some(between), 4096).contains(part), "{between}: {}", judged(Some(between), 4096));
        }
    }
}
