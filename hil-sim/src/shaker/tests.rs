use super::*;

fn command() -> Command {
    let phase_increment = phase_increment(5.0, 500.0).unwrap();
    Command { phase: 123_456_789, phase_increment, amplitude_nanometre: [10_000_000, 10_050_000], ..Command::default() }
}

/// Second difference of the displacement.
fn differenced(motion: &BaseMotion, t: f64) -> [f64; 2] {
    let h = 1e-4;
    let [a, b, c] = [t - h, t, t + h].map(|t| motion.displacement(t));
    [0, 1].map(|i| (a[i] - 2.0 * b[i] + c[i]) / (h * h))
}

#[test]
fn acceleration_is_the_second_derivative_of_the_displacement() {
    for direction in [Direction::Vertical, Direction::Horizontal] {
        let additions = DriveAdditions {
            harmonics: vec![(2.0, 0.1, 0.4), (3.0, 0.05, -1.0)],
            across: [1e-3, -2e-3],
            amplitude_drift: 0.3,
            frequency_offset_hz: 0.2,
            hum: Hum { amplitude_m: 2e-5, frequency_hz: 50.3 },
            ..DriveAdditions::default()
        };
        let shaker = Shaker { direction, psi: 0.7, additions, record_s: 10.0 };
        let motion = shaker.motion(command(), 3.0, 0.002);
        for t in [0.0, 0.001, 0.002] {
            let (exact, numeric) = (motion.acceleration(t), differenced(&motion, t));
            for i in 0..2 {
                assert!((exact[i] - numeric[i]).abs() < 1e-4 * (1.0 + exact[i].abs()), "{exact:?} {numeric:?}");
            }
        }
    }
}

#[test]
fn hum_is_there_at_rest_and_keeps_its_own_time() {
    let hum = Hum { amplitude_m: 2e-5, frequency_hz: 50.3 };
    for direction in [Direction::Vertical, Direction::Horizontal] {
        let additions = DriveAdditions { hum, ..DriveAdditions::default() };
        let along = usize::from(direction == Direction::Vertical);
        let motion = Shaker { direction, additions, ..Shaker::default() }.motion(Command::default(), 3.0, 0.002);
        for t in [0.0, 0.0007, 0.002] {
            let angle = TAU * 50.3 * (3.0 + t);
            assert!((motion.displacement(t)[along] - 2e-5 * angle.sin()).abs() < 1e-16);
            assert!((motion.acceleration(t)[along] + 2e-5 * (TAU * 50.3_f64).powi(2) * angle.sin()).abs() < 1e-9);
            assert!((motion.velocity(t)[along] - 2e-5 * TAU * 50.3 * angle.cos()).abs() < 1e-12);
            assert_eq!([motion.displacement(t)[1 - along], motion.acceleration(t)[1 - along]], [0.0; 2]);
        }
    }
}

#[test]
fn one_tick_joins_the_next_without_a_jump() {
    let additions = DriveAdditions {
        harmonics: vec![(2.0, 0.1, 0.4)],
        amplitude_drift: 0.2,
        frequency_offset_hz: -0.3,
        hum: Hum { amplitude_m: 2e-5, frequency_hz: 50.3 },
        ..DriveAdditions::default()
    };
    let shaker = Shaker { psi: -0.3, additions, record_s: 7.0, ..Shaker::default() };
    let now = command();
    let next = Command {
        phase: now.phase.wrapping_add(now.phase_increment),
        amplitude_nanometre: [now.amplitude_nanometre[1], 10_200_000],
        ..now
    };
    let end = shaker.motion(now, 1.0, 0.002).displacement(0.002);
    let start = shaker.motion(next, 1.002, 0.002).displacement(0.0);
    assert!((end[1] - start[1]).abs() < 1e-14, "{end:?} {start:?}");
    let later = shaker.motion(now, 1.0, 0.002).later(0.0007);
    let direct = shaker.motion(now, 1.0, 0.002);
    assert!((later.acceleration(0.001)[1] - direct.acceleration(0.0017)[1]).abs() < 1e-12);
}

#[test]
fn a_vertical_drive_is_a_cos_upward_and_a_horizontal_one_a_sin() {
    let quiet = Command { phase: 0, amplitude_nanometre: [10_000_000; 2], ..command() };
    let vertical = Shaker { psi: 0.0, ..Shaker::default() }.motion(quiet, 0.0, 0.002);
    let horizontal = Shaker { direction: Direction::Horizontal, ..Shaker::default() }.motion(quiet, 0.0, 0.002);
    let t: f64 = 0.0015;
    let angle = vertical.omega * t;
    assert!((vertical.displacement(t)[1] - 0.01 * angle.cos()).abs() < 1e-15);
    assert_eq!(vertical.displacement(t)[0], 0.0);
    assert!((horizontal.displacement(t)[0] - 0.01 * angle.sin()).abs() < 1e-15);
    assert_eq!(horizontal.displacement(t)[1], 0.0);
}

#[test]
fn frequencies_are_quantised_to_turns_of_two_to_the_32() {
    assert_eq!(phase_increment(5.0, 500.0), Some(42_949_673));
    assert_eq!(phase_increment(0.0, 500.0), None);
    assert_eq!(phase_increment(250.0, 500.0), None);
    assert_eq!(phase_increment(f64::NAN, 500.0), None);
    assert_eq!(phase_increment(1e-12, 500.0), None);
    assert!((phase_radians(1 << 30) - FRAC_PI_2).abs() < 1e-15);
    assert!((phase_radians(3 << 30) + FRAC_PI_2).abs() < 1e-15);
}
