use super::*;

fn rig() -> Rig {
    let text = include_str!("../../../rigs/chaotic.toml");
    Rig::parse(text, std::path::Path::new("rig.toml")).unwrap()
}

/// Arm 1 swings at the drive's 5 Hz, arm 2 turns once a second; 500 Hz.
pub(in crate::terminal_view) fn sample(tick: u32) -> SeenSample {
    let t = f64::from(tick) / 500.0;
    let increment = 42_949_673_u32;
    let swing = 400.0 * (core::f64::consts::TAU * 5.0 * t).sin();
    SeenSample {
        tick,
        counts: whirl_shared::block::Counts::of(&[swing.round() as i32, (4096.0 * t).floor() as i32]),
        phase: increment.wrapping_mul(tick),
        phase_increment: increment,
        amplitude_nm: 15_525_000,
    }
}

pub(in crate::terminal_view) fn standing(recording: bool) -> Standing {
    Standing {
        progress: crate::capture::Progress {
            state: "recording",
            samples: 30_600,
            lost: 40,
            device_s: 61.28,
            target_s: Some(120.0),
            estimate: None,
            notices: Vec::new(),
        },
        losses: crate::record::Losses { received: 30_600, lost_on_link: 40, gaps: 1, ..Default::default() },
        reconnections: 1,
        recording,
        asked: Some((0.015_525, 5.0)),
        estimate: None,
        precision: None,
        simulated: true,
    }
}

fn seen(ticks: core::ops::Range<u32>, recording: bool) -> Seen {
    Seen { samples: ticks.map(sample).collect(), standing: Some(standing(recording)), ..Seen::default() }
}

#[test]
fn the_section_holds_a_point_a_period_from_the_recording_on() {
    let mut scene = Scene::new(&rig(), "r");
    scene.take(seen(0..1_000, false));
    assert!(!scene.arms[0].section.is_empty());
    scene.take(seen(1_000..1_001, true));
    assert!(scene.arms[0].section.is_empty());
    scene.take(seen(1_001..6_000, true));
    let points = &scene.arms[0].section;
    // 10 s at 5 Hz.
    assert!((49..=51).contains(&points.len()), "{}", points.len());
    // A strobed motion at the drive's frequency is one point: angle 0, rate 2π·5·400 counts a
    // second.
    let rate = core::f64::consts::TAU * 5.0 * 400.0 * 360.0 / 4096.0;
    assert!(points.iter().all(|p| p.0.abs() < 0.3 && (p.1 / rate - 1.0).abs() < 0.05), "{points:?}");
    // The arm that turns: 360 degrees a second.
    assert!((scene.arms[1].fastest / 360.0 - 1.0).abs() < 0.05, "{}", scene.arms[1].fastest);
    assert!((scene.arms[0].fastest / rate - 1.0).abs() < 0.05);
}

#[test]
fn what_is_shown_is_the_last_seconds_and_memory_is_bounded() {
    let mut scene = Scene::new(&rig(), "r");
    scene.take(seen(u32::MAX - 20_000..u32::MAX, true));
    scene.take(seen(u32::MAX..u32::MAX, true));
    assert!(scene.history.len() <= 10_100, "{}", scene.history.len());
    let angles = scene.angles(1);
    assert_eq!((angles.len(), angles.last().unwrap().0), (2_501, 0.0));
    assert!((angles[0].0 + 5.0).abs() < 1e-9 && angles.iter().all(|a| (-180.0..=180.0).contains(&a.1)));
    scene.zoom(false);
    assert_eq!((scene.span_s(), scene.angles(0).len()), (2.0, 1_001));
    for _ in 0..9 {
        scene.zoom(true);
    }
    assert_eq!(scene.span_s(), LONGEST_S);
}

#[test]
fn repeats_are_left_out_and_no_rate_reaches_over_a_gap() {
    let mut scene = Scene::new(&rig(), "r");
    scene.take(seen(0..500, true));
    scene.take(seen(490..500, true));
    assert_eq!(scene.history.len(), 500);
    scene.take(seen(700..800, true));
    let portrait = scene.portrait(0);
    // Each stretch loses a lag at both ends.
    assert_eq!(portrait.len(), 600 - 4 * scene.lag);
    // After a restart it goes on from the new ticks.
    scene.take(seen(5_000..5_500, true));
    scene.take(seen(0..100, true));
    assert_eq!(scene.history.len(), 100);
}
