//! The shaker's limits, ramps and silence.

use whirl_firmware::shaker::Shaker;
use whirl_firmware::{Settings, ShakerOutput};
use whirl_shared::frame::{Command, CommandResult, ShakerState, StopCause};

/// The last set point, the greatest size of all, and the enable pin.
#[derive(Default)]
struct Stage {
    last: i32,
    most: u32,
    on: bool,
}

impl ShakerOutput for Stage {
    type Error = ();

    fn write(&mut self, displacement_nanometre: i32) -> Result<(), ()> {
        self.last = displacement_nanometre;
        self.most = self.most.max(displacement_nanometre.unsigned_abs());
        Ok(())
    }

    fn enable(&mut self, on: bool) -> Result<(), ()> {
        self.on = on;
        Ok(())
    }
}

fn shaker() -> Shaker<Stage> {
    Shaker::new(&Settings::default(), Stage::default())
}

const START: Command = Command::Start { amplitude_micrometre: 15_525, frequency_millihertz: 5_000 };

/// Ticks, with a host that lives.
fn run(shaker: &mut Shaker<Stage>, ticks: u32) {
    for tick in 0..ticks {
        if tick % 100 == 0 {
            shaker.command(Command::KeepAlive);
        }
        shaker.tick();
    }
}

pub fn nothing_moves_before_it_is_told_to() {
    let mut shaker = shaker();
    run(&mut shaker, 2_000);
    assert_eq!(shaker.command(START), CommandResult::WrongState);
    run(&mut shaker, 2_000);
    assert_eq!((shaker.state(), shaker.output_mut().most, shaker.output_mut().on), (ShakerState::Disarmed, 0, false));
}

pub fn limits_are_kept_and_refusals_change_nothing() {
    let mut shaker = shaker();
    assert_eq!(shaker.command(Command::Arm), CommandResult::Done);
    let out = |limit| CommandResult::OutOfRange { limit };
    for (amplitude_micrometre, frequency_millihertz, result) in [
        (20_001, 5_000, out(20_000)),
        (1, 20_001, out(20_000)),
        (1, 0, out(1)),
        // 40 m/s² at 20 Hz are 2.533 mm.
        (2_534, 20_000, out(2_533)),
    ] {
        assert_eq!(shaker.command(Command::Start { amplitude_micrometre, frequency_millihertz }), result);
        assert_eq!(shaker.state(), ShakerState::Armed);
    }
    run(&mut shaker, 500);
    assert_eq!(shaker.output_mut().most, 0);
    assert_eq!(shaker.command(START), CommandResult::Done);
    run(&mut shaker, 1_500);
    assert_eq!(shaker.state(), ShakerState::Running);
    for refused in [
        Command::SetRamp { micrometre_per_s: 5 },
        Command::SetHostTimeout { ms: 500 },
        Command::ZeroCounts,
        Command::Start { amplitude_micrometre: 15_525, frequency_millihertz: 5_001 },
    ] {
        assert_eq!(shaker.command(refused), CommandResult::WrongState);
    }
    assert_eq!((shaker.ramp_micrometre_per_s(), shaker.host_timeout_ms()), (20_000, 2_000));
    assert_eq!(shaker.output_mut().most, 15_525_000);
}

pub fn ramps_are_never_faster_than_set() {
    let mut shaker = shaker();
    shaker.command(Command::Arm);
    assert_eq!(shaker.command(Command::SetRamp { micrometre_per_s: 3_000 }), CommandResult::Done);
    shaker.command(START);
    let mut last = 0;
    for tick in 0..6_000_u32 {
        match tick {
            2_900 => {
                shaker.command(Command::Start { amplitude_micrometre: 4_000, frequency_millihertz: 5_000 });
            }
            4_500 => {
                shaker.command(Command::Stop);
            }
            _ if tick % 100 == 0 => {
                shaker.command(Command::KeepAlive);
            }
            _ => {}
        }
        shaker.tick();
        let amplitude = shaker.drive().amplitude_nanometre;
        // 3 mm/s at 500 Hz, rounded up.
        assert!(amplitude.abs_diff(last) <= 6_001, "tick {tick}: {last} to {amplitude} nm");
        last = amplitude;
    }
    assert_eq!((shaker.state(), last, shaker.output_mut().last), (ShakerState::Armed, 0, 0));
}

pub fn silence_stops_it() {
    let mut shaker = shaker();
    shaker.command(Command::Arm);
    shaker.command(START);
    run(&mut shaker, 1_000);
    assert!(shaker.output_mut().on);
    for _ in 0..3_000 {
        shaker.tick();
    }
    assert_eq!((shaker.state(), shaker.stop_cause()), (ShakerState::Disarmed, StopCause::HostSilent));
    assert_eq!((shaker.output_mut().last, shaker.output_mut().on), (0, false));
}
