//! Gaps are filled where what is missing is known to the noise, and there alone.

use super::*;
use crate::record::Column;

const STEP: f64 = 0.004;

/// A swing of 1.3 Hz in counts of 1000 a turn, and what drives it.
fn counts(i: usize) -> i32 {
    let t = i as f64 * STEP;
    (159.15 * (1.1 * (8.2 * t).sin() + 0.4 * (19.0 * t + 1.0).sin())).floor() as i32
}

fn force(i: usize) -> f64 {
    (3.0 * i as f64 * STEP).sin()
}

/// Rows of `0..count` without those that `lost` names, as stretches.
fn record(count: usize, lost: impl Fn(usize) -> bool, columns: impl Fn(&[usize]) -> Vec<Column>) -> Record {
    let mut segments = Vec::new();
    let kept: Vec<usize> = (0..count).filter(|i| !lost(*i)).collect();
    for rows in kept.chunk_by(|a, b| a + 1 == *b) {
        let mut segment = Segment::new(rows[0] as f64 * STEP, STEP, columns(rows));
        segment.phase = Some(rows.iter().map(|i| (*i as u32).wrapping_mul(400_000_000)).collect());
        segments.push(segment);
    }
    let channels = segments[0].columns.iter().map(|_| crate::rig::Channel::new("q", "count")).collect();
    Record { segments, channels, ..Record::default() }
}

fn both(rows: &[usize]) -> Vec<Column> {
    let counts = rows.iter().map(|i| counts(*i)).collect();
    vec![Column::Counts(counts), Column::Values(rows.iter().map(|i| force(*i)).collect())]
}

/// One to three rows are filled to a count; a gap of ten rows stays, and gaps close to each other.
#[test]
fn short_gaps_are_filled_and_long_ones_stay() {
    let lost = |i: usize| i > 1 && (i.is_multiple_of(131) || i % 197 < 2 || (900..910).contains(&i));
    let mut r = record(2000, lost, both);
    let missing = (0..2000).filter(|i| lost(*i)).count() as u64;
    let filled = fill(&mut r, &[None, None], &[0]);
    // Between 786 and 788, 1179 and 1182, 1572 and 1576 are fewer rows than a value is made of: those
    // six gaps, of nine rows, stay.
    assert_eq!((r.segments.len(), filled.rows, filled.longest), (8, missing - 10 - 9, 3));
    for s in &r.segments {
        let first = (s.start_s / STEP).round() as usize;
        let Column::Counts(c) = &s.columns[0] else { panic!("counts stay counts") };
        let Column::Values(u) = &s.columns[1] else { panic!("values stay values") };
        assert!(c.iter().enumerate().all(|(i, c)| c.abs_diff(counts(first + i)) <= 1));
        assert!(u.iter().enumerate().all(|(i, u)| (u - force(first + i)).abs() < 1e-6));
        let phase = s.phase.as_ref().unwrap();
        assert!(phase.iter().enumerate().all(|(i, p)| *p == ((first + i) as u32).wrapping_mul(400_000_000)));
        assert!((s.start_s - first as f64 * STEP).abs() < 1e-12 && (s.step_s - STEP).abs() < 1e-15);
    }
}

/// What leaps in a gap is not joined; by whole turns it may, where a turn is all that is recorded.
#[test]
fn what_does_not_go_on_is_not_joined() {
    let leaps = |by: i32| {
        move |rows: &[usize]| vec![Column::Counts(rows.iter().map(|i| counts(*i) + by * i32::from(*i > 700)).collect())]
    };
    let joined = |by: i32, modulus: Option<f64>| {
        let mut r = record(1400, |i| i == 700, leaps(by));
        fill(&mut r, &[modulus], &[0]);
        r.segments.len()
    };
    assert_eq!([joined(0, None), joined(40, None), joined(-1000, None), joined(-1000, Some(1000.0))], [1, 2, 2, 1]);
}

/// Without noise, or with a motion too fast for its rate, or an input that is new at every row,
/// nothing is known to the noise.
#[test]
fn what_is_not_known_stays_missing() {
    let segments = |columns: &dyn Fn(usize) -> Vec<f64>, sensors: &[usize]| {
        let of = |rows: &[usize]| {
            let width = columns(0).len();
            (0..width).map(|k| Column::Values(rows.iter().map(|i| columns(*i)[k]).collect())).collect()
        };
        let mut r = record(1500, |i| i == 700, of);
        fill(&mut r, &[None, None], sensors);
        r.segments.len()
    };
    let chance = |i: usize| f64::from((i as u32).wrapping_mul(2_654_435_761) >> 16) / 65_536.0;
    let shown = |i: usize| f64::from(counts(i)) + chance(i);
    assert_eq!(segments(&|i| vec![shown(i), force(i)], &[0]), 1);
    assert_eq!(segments(&|i| vec![shown(i), chance(i + 7000)], &[0]), 2, "white input");
    assert_eq!(segments(&|i| vec![force(i)], &[0]), 2, "no noise");
    assert_eq!(segments(&|i| vec![(1.1 * i as f64).sin()], &[0]), 2, "5.7 rows a period");
    let held = |i: usize| chance(i / 20 * 20);
    assert_eq!(segments(&|i| vec![shown(i), held(i)], &[0]), 1, "a command that is held");
}
