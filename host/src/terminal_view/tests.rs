use ratatui::Terminal;
use ratatui::backend::TestBackend;
use whirl_shared::frame::{Hello, ShakerState, Status, Zero};

use super::scene::tests::{sample, standing};
use super::*;
use crate::capture::estimates::{DeviceEstimate, Status as Known};
use crate::capture::feed::Seen;
use crate::model::parameter::Parameter;

fn scene(samples: u32) -> Scene {
    let text = include_str!("../../../rigs/chaotic.toml");
    let rig = Rig::parse(text, std::path::Path::new("rig.toml")).unwrap();
    let mut scene = Scene::new(&rig, "run1.parquet");
    let values = [0.113, 0.0708, -0.1107, -1.2e-6, 0.00102, 0.0123, 1.682, 0.9, -0.9, 2e-5, 0.0485];
    let parameters = whirl_shared::regressor::NAMES.iter().zip(values).map(|(name, value)| Parameter {
        name: (*name).to_owned(),
        value,
        std_error: 4e-4,
        unit: "1".to_owned(),
    });
    let estimate = DeviceEstimate {
        tick: 5_000,
        t: 10.0,
        window_s: 4.0,
        windows: 12,
        forgetting: 0.9,
        drive_frequency_hz: 5.0,
        amplitude_m: 0.015_525,
        status: Known::Known,
        reason: None,
        parameters: parameters.collect(),
        condition: vec![1.5, 2.0],
        residual_rms: vec![0.1, 0.2],
    };
    let precision = crate::capture::precision::Precision {
        name: "C2".to_owned(),
        asked_percent: 1.0,
        percent: Some(2.3),
        left_s: Some(200.0),
        reached: false,
    };
    scene.take(Seen {
        samples: (0..samples).map(sample).collect(),
        hello: Some(Hello {
            counts_per_turn: [4096; 2].into(),
            reversed: [false; 2].into(),
            zeros: [Zero::default(); 2].into(),
            ..Hello::default()
        }),
        status: Some(Status { shaker: ShakerState::Running, ..Status::default() }),
        standing: Some(crate::capture::feed::Standing {
            estimate: Some(estimate),
            precision: Some(precision),
            ..standing(true)
        }),
        lines: vec!["the device says: hello".to_owned()],
    });
    scene
}

/// The screen as text.
fn screen(scene: &Scene, width: u16, height: u16) -> String {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw::draw(frame, scene)).unwrap();
    let buffer = terminal.backend().buffer();
    (0..height).map(|y| (0..width).map(|x| buffer[(x, y)].symbol()).collect::<String>() + "\n").collect()
}

#[test]
fn every_size_is_drawn_and_a_small_one_says_so() {
    let (empty, full) = (scene(0), scene(6_000));
    for page in [Page::Motion, Page::FirstLight] {
        for mut of in [scene(0), scene(1), scene(6_000)] {
            of.page = page;
            for (width, height) in [(1, 1), (20, 5), (79, 24), (80, 24), (139, 30), (140, 24), (160, 50), (400, 120)] {
                screen(&of, width, height);
            }
        }
    }
    assert!(screen(&full, 60, 5).contains("60 × 5"), "{}", screen(&full, 60, 5));
    assert!(screen(&full, 60, 5).contains("80 × 24"));
    assert!(screen(&empty, 80, 24).contains("no samples yet"));
}

#[test]
fn all_that_matters_is_on_the_screen_with_its_units() {
    let scene = scene(6_000);
    for (width, height) in [(80, 24), (160, 50)] {
        let text = screen(&scene, width, height);
        println!("{text}");
        for part in [
            "recording",
            "61.3 s of 120 s",
            "51 %",
            "run1.parquet",
            "θ₁",
            "θ₂",
            "last 5 s",
            "now",
            "°/s",
            "−180",
            "180",
            "section",
            "phase 0: 5",
            "points",
            "30 600",
            "40",
            "1 gap",
            "lost once",
            "enabled, running",
            "15.525 mm of 15.525 asked",
            "5.000 Hz",
            "mm",
            "m/s²",
            "B11",
            "0.1130",
            "0.0008",
            "C2",
            "± is 95 %",
            "C2 to ±1.0 % (95 %): now ±2.3 %, about 3 min 20 s still",
            "Tab",
            "q",
        ] {
            assert!(text.replace('\u{202f}', " ").contains(part), "{width} × {height}: {part}\n{text}");
        }
        // Dots were drawn.
        assert!(text.chars().filter(|c| ('\u{2801}'..='\u{28ff}').contains(c)).count() > 40, "{text}");
    }
}

#[test]
fn first_light_says_what_each_encoder_does() {
    let mut scene = scene(6_000);
    scene.page = Page::FirstLight;
    let text = screen(&scene, 80, 24);
    println!("{text}");
    for part in [
        "THE SHAKER IS ON",
        "encoder 1: θ₁",
        "arm 2 against arm 1",
        "counts up (+)",
        "11.998 turns",
        "not seen yet",
        "as wired",
        "power-up",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    let at_rest = |tick| crate::capture::feed::SeenSample { phase_increment: 0, amplitude_nm: 0, ..sample(tick) };
    scene.take(Seen { samples: vec![at_rest(6_001)], ..Seen::default() });
    let text = screen(&scene, 80, 24);
    assert!(text.contains("Turn one arm by one whole turn") && text.contains("whirl device zero"), "{text}");
    println!("{text}");
}
