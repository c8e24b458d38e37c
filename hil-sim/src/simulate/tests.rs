use super::*;

fn simulate(settings: &SimulationSettings, samples: usize) -> Vec<Sample> {
    let mut simulation = Simulation::new(settings).unwrap();
    (0..samples).map(|_| simulation.next_sample().unwrap()).collect()
}

fn with(effects: &[&str]) -> SimulationSettings {
    let effects = effects.iter().map(|text| Effect::parse(text).unwrap()).collect();
    SimulationSettings { effects, settle_s: 1.0, seed: None, ..SimulationSettings::default() }
}

/// A short, quiet stretch: 1000 samples of a free system.
fn free(effects: &[&str], initial: State) -> Vec<Sample> {
    simulate(&SimulationSettings { drive: None, settle_s: 0.0, initial, ..with(effects) }, 1000)
}

#[test]
fn ticks_phase_and_amplitude_are_the_device_s() {
    let samples = simulate(&with(&[]), 300);
    assert_eq!((samples[0].tick, samples[299].tick), (0, 299));
    assert!(samples.iter().all(|s| s.amplitude_nanometre == 15_525_000));
    // 500 ticks of settling and 299 more.
    assert_eq!(samples[299].phase, 42_949_673_u32.wrapping_mul(799));
    let quiet = free(&[], [0.3, 2.0, 0.0, 0.0]);
    assert!(quiet.iter().all(|s| s.phase == 0 && s.amplitude_nanometre == 0));
    assert_eq!(quiet[0].counts, [(0.3 / std::f64::consts::TAU * 4096.0) as i32, 1108]);
}

#[test]
fn seeds_give_different_histories_and_the_same_seed_the_same() {
    let run = |seed| {
        let settings = SimulationSettings { seed: Some(seed), ..SimulationSettings::default() };
        simulate(&settings, 200).iter().map(|s| s.counts).collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
    for seed in 0..200 {
        let state = perturbed([1.0, -1.0, 0.0, 5.0], seed);
        assert!((state[0] - 1.0).abs() <= ANGLE_SPREAD && (state[3] - 5.0).abs() <= RATE_SPREAD);
    }
}

#[test]
fn counts_are_the_floor_of_the_angles_shown() {
    for sample in simulate(&with(&["eccentricity@encoder1=0.02,psi=1"]), 500) {
        for i in 0..2 {
            let counts = sample.angles[i] / (2.0 * std::f64::consts::PI) * 4096.0;
            assert!(
                (0.0..1.0).contains(&(counts - f64::from(sample.counts[i]))) || (counts - counts.round()).abs() < 1e-9
            );
        }
    }
}

#[test]
fn encoder_errors_act_on_the_measurement_alone() {
    let plain = simulate(&with(&[]), 500);
    let effects = ["zero-offset@encoder1=0.1", "scale-error@encoder2=0.01", "eccentricity@encoder2=0.05,psi=0.3"];
    for (a, b) in plain.iter().zip(simulate(&with(&effects), 500)) {
        assert!((b.angles[0] - a.angles[0] - 0.1).abs() < 1e-12);
        let scaled = 1.01 * a.angles[1];
        assert!((b.angles[1] - (scaled + 0.05 * (scaled + 0.3).sin())).abs() < 1e-12);
    }
}

#[test]
fn a_zero_that_drifts_adds_up_over_the_record() {
    let mut settings = with(&[]);
    (settings.record_s, settings.settle_s) = (2.0, 0.5);
    let plain = simulate(&settings, 500);
    settings.effects = with(&["zero-drift@encoder2=0.3"]).effects;
    let drifting = simulate(&settings, 500);
    for (k, (a, b)) in plain.iter().zip(&drifting).enumerate() {
        let share = k as f64 * 0.002 / 2.0;
        assert_eq!(a.angles[0], b.angles[0]);
        assert!((b.angles[1] - a.angles[1] - 0.3 * share).abs() < 1e-12, "{k}");
    }
    // Encoder 1 held back: the rig runs ahead of what is shown.
    settings.effects = with(&["channel-delay@encoder2=-0.006"]).effects;
    let late = simulate(&settings, 500);
    settings.effects = with(&["channel-delay@encoder2=-0.006", "zero-drift@encoder1=0.3"]).effects;
    for (k, (a, b)) in late.iter().zip(simulate(&settings, 500)).enumerate() {
        assert!((b.angles[0] - a.angles[0] - 0.3 * (k as f64 * 0.002 / 2.0)).abs() < 1e-12, "{k}");
    }
}

#[test]
fn a_delayed_channel_shows_what_the_other_showed_before() {
    let plain = simulate(&with(&[]), 500);
    // Whole ticks: exactly the sample of before; encoder 1 and phase stay.
    for (ticks, text) in [(3_usize, "channel-delay@encoder2=0.006"), (0, "channel-delay@encoder2=0")] {
        let delayed = simulate(&with(&[text]), 500);
        for n in ticks..500 {
            assert_eq!(delayed[n].angles[0], plain[n].angles[0]);
            assert!((delayed[n].angles[1] - plain[n - ticks].angles[1]).abs() < 1e-9);
            assert_eq!(delayed[n].phase, plain[n].phase);
        }
    }
    // Parts of a tick: between the two samples, by the angle's own rate; both signs.
    for delay in [0.0005, 0.0027, -0.0005, -0.0047] {
        let delayed = simulate(&with(&[&format!("channel-delay@encoder2={delay}")]), 500);
        for n in 5..490 {
            let (first, at) = (&delayed[n], n as f64 - delay / 0.002);
            assert!((first.angles[0] - plain[n].angles[0]).abs() < 1e-7, "{delay} {n}");
            assert_eq!((first.phase, first.tick), (plain[n].phase, plain[n].tick));
            let (low, share) = (at.floor() as usize, at - at.floor());
            let [a, b] = [plain[low].angles[1], plain[low + 1].angles[1]];
            let between = a + share * (b - a);
            assert!((first.angles[1] - between).abs() < 0.002, "{delay} at {n}: {} {between}", first.angles[1]);
        }
    }
}

#[test]
fn exactly_equivalent_pairs_give_the_same_angles() {
    // imbalance@arm2 of beta and zero-offset@encoder2 of −beta, with the arm started where its
    // centroid is.
    let beta = 0.05;
    let imbalance = free(&["imbalance@arm2=0.05"], [0.4, 1.0, 0.0, 0.0]);
    let offset = free(&["zero-offset@encoder2=-0.05"], [0.4, 1.0 + beta, 0.0, 0.0]);
    for (a, b) in imbalance.iter().zip(&offset) {
        assert!((a.angles[1] - b.angles[1]).abs() < 1e-7 && (a.angles[0] - b.angles[0]).abs() < 1e-7);
    }
    // A tilted frame without a drive is a zero offset of encoder 1.
    let tilt = free(&["frame-tilt@frame=0.05"], [0.4 + beta, 1.0 + beta, 0.0, 0.0]);
    let zero = free(&["zero-offset@encoder1=0.05"], [0.4, 1.0, 0.0, 0.0]);
    for (a, b) in tilt.iter().zip(&zero) {
        assert!((a.angles[0] - b.angles[0]).abs() < 1e-7 && (a.angles[1] - b.angles[1]).abs() < 1e-7);
    }
}

/// Sampling at 500 Hz by a clock whose second lasts 1.25 s is sampling at 400 Hz.
#[test]
fn a_slow_clock_is_a_lower_rate() {
    let angles = |effects: &[&str], sample_rate_hz| -> Vec<_> {
        let settings = SimulationSettings { drive: None, settle_s: 0.0, sample_rate_hz, ..with(effects) };
        simulate(&settings, 250).iter().map(|s| s.angles).collect()
    };
    for (a, b) in angles(&["time-base@frame=0.25"], 500.0).iter().zip(angles(&[], 400.0)) {
        assert!((a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-6, "{a:?} {b:?}");
    }
}

#[test]
fn every_effect_runs_and_changes_the_counts() {
    let plain: Vec<_> = simulate(&with(&[]), 250).iter().map(|s| s.counts).collect();
    for info in effects::LIST.iter().filter(|info| info.id != "vertical-motion") {
        for place in info.places {
            // Strong enough to be seen after a second and a half.
            let value = match info.unit {
                "N m" | "N m/rad" | "N m/rad^2" | "N m/rad^3" | "N m/rad^5" => 1e-3,
                "N m s" | "N m s/rad^2" => 1e-4,
                "N m s^2" => 1e-5,
                "rad" => 0.1,
                "Hz" => 0.1,
                "s" => 0.01,
                "m" => 1e-3,
                _ => 0.1,
            };
            let effect = format!("{}@{}={value}", info.id, place.name());
            let counts =
                |effects: &[&str]| -> Vec<_> { simulate(&with(effects), 250).iter().map(|s| s.counts).collect() };
            // A ripple takes from a level that is there.
            let level = format!("coulomb-friction@{}={value}", place.name());
            let (got, without) = if info.id == "friction-ripple" {
                (counts(&[&level, &effect]), counts(&[&level]))
            } else {
                (counts(&[&effect]), plain.clone())
            };
            assert_ne!(got, without, "{effect}");
        }
    }
}

#[test]
fn a_horizontal_drive_runs_and_takes_vertical_motion_only() {
    let drive = |d: DriveSettings| Some(DriveSettings { direction: Direction::Horizontal, ..d });
    let horizontal = |effects: &[&str]| {
        let settings = with(effects);
        SimulationSettings { drive: settings.drive.and_then(drive), ..settings }
    };
    // At rest, hanging: a horizontal drive moves the arms, a vertical one does not.
    let rest = |settings: SimulationSettings| {
        simulate(&SimulationSettings { initial: [0.0; 4], ..settings }, 100).iter().any(|s| s.angles[0].abs() > 0.01)
    };
    assert!(rest(horizontal(&[])));
    assert!(!rest(with(&[])));
    assert!(Simulation::new(&horizontal(&["vertical-motion@drive=1e-3"])).is_ok());
    assert!(Simulation::new(&horizontal(&["horizontal-motion@drive=1e-3"])).is_err());
    assert!(Simulation::new(&with(&["vertical-motion@drive=1e-3"])).is_err());
}

#[test]
fn bad_settings_are_named() {
    let told = |settings: SimulationSettings| Simulation::new(&settings).unwrap_err().to_string();
    let base = with(&[]);
    let drive = base.drive.unwrap();
    assert!(told(SimulationSettings { sample_rate_hz: 0.0, ..base.clone() }).contains("sample_rate_hz is 0"));
    assert!(told(SimulationSettings { sample_rate_hz: f64::NAN, ..base.clone() }).contains("NaN"));
    assert!(told(SimulationSettings { settle_s: 1e9, ..base.clone() }).contains("settle_s"));
    assert!(told(SimulationSettings { counts_per_turn: [0, 1], ..base.clone() }).contains("counts_per_turn"));
    assert!(told(SimulationSettings { initial: [f64::INFINITY; 4], ..base.clone() }).contains("initial"));
    let fast = DriveSettings { frequency_hz: 251.0, ..drive };
    assert!(told(SimulationSettings { drive: Some(fast), ..base.clone() }).contains("frequency_hz is 251"));
    let wide = DriveSettings { amplitude_m: -1.0, ..drive };
    assert!(told(SimulationSettings { drive: Some(wide), ..base.clone() }).contains("amplitude_m"));
    let undriven = SimulationSettings { drive: None, ..with(&["drive-harmonic-2@drive=0.1"]) };
    assert!(told(undriven).contains("[drive]"));
    assert!(told(with(&["frequency-offset@drive=-5"])).contains("frequency-offset"));
}

#[test]
fn what_cannot_be_integrated_ends_with_an_error() {
    // An unstable spring throws the arms out of every bound.
    let settings = with(&["torsion-spring@joint1=-1e6", "cubic-stiffness@joint2=1e6"]);
    let result = Simulation::new(&settings).and_then(|mut simulation| {
        for _ in 0..2_000 {
            simulation.next_sample()?;
        }
        Ok(())
    });
    assert!(matches!(result, Err(SimulationError::Integration { .. })), "{result:?}");
}

/// J θ″ = −A cos(ωt − ψ) = −(C cos ωt + S sin ωt) without gravity, t = 0 at the record's first
/// sample, whatever the settling.
#[test]
fn a_tone_runs_in_the_laboratory_s_time() {
    let (c, s, j, settle) = (3e-3_f64, -2e-3_f64, 2e-3, 0.5);
    let omega = 3.7 * std::f64::consts::TAU;
    let settings = SimulationSettings {
        parameters: Parameters::single(0.2, 0.05, j, 0.0, 0.0),
        drive: None,
        initial: [0.4, 0.0, 1.0, 0.0],
        settle_s: settle,
        sample_rate_hz: 100.0,
        ..with(&[&format!("tone@joint1={},f=3.7,psi={}", f64::hypot(c, s), f64::atan2(s, c))])
    };
    let (sin, cos) = (-omega * settle).sin_cos();
    let drift = 1.0 + (c * sin - s * cos) / (j * omega);
    for (i, sample) in simulate(&settings, 300).iter().enumerate() {
        let t = i as f64 / 100.0;
        let (sin_t, cos_t) = (omega * t).sin_cos();
        let swung = (c * (cos_t - cos) + s * (sin_t - sin)) / (j * omega * omega);
        let want = 0.4 + drift * (t + settle) + swung;
        assert!((sample.angles[0] - want).abs() < 1e-9, "{t}: {} {want}", sample.angles[0]);
    }
}
