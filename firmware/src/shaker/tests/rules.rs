//! Whatever is commanded, missed or broken.

use proptest::prelude::*;
use std::format;

use super::*;

fn any_command() -> impl Strategy<Value = Command> {
    prop_oneof![
        Just(Command::Hello),
        Just(Command::KeepAlive),
        Just(Command::Arm),
        Just(Command::Disarm),
        Just(Command::Stop),
        Just(Command::ZeroCounts),
        Just(Command::Status),
        Just(START),
        (0_u32..25_000, 0_u32..25_000).prop_map(|(amplitude_micrometre, frequency_millihertz)| Command::Start {
            amplitude_micrometre,
            frequency_millihertz
        }),
        (0_u32..25_000).prop_map(|micrometre_per_s| Command::SetRamp { micrometre_per_s }),
        (0_u32..70_000).prop_map(|ms| Command::SetHostTimeout { ms }),
    ]
}

proptest! {
    /// Whatever is commanded, missed or broken: the rules of the house.
    #[test]
    fn rules_that_always_hold(
        steps in proptest::collection::vec((any_command(), 0_u32..400, 0_u8..40, 0_u32..4), 1..60),
    ) {
        let mut shaker = shaker();
        for (command, ticks, broken, missed) in steps {
            let before = format!("{shaker:?}");
            let result = shaker.command(command);
            if result != CommandResult::Done && shaker.state() != ShakerState::Faulted {
                prop_assert_eq!(before, format!("{shaker:?}"), "refused, but something changed: {:?}", command);
            }
            shaker.output.fail_write = broken == 0;
            shaker.output.fail_enable = broken == 1;
            shaker.skip(missed);
            for _ in 0..ticks {
                let before = shaker.drive();
                let writes = shaker.output.writes.len();
                let moving = shaker.moving();
                shaker.tick();
                let after = shaker.drive();
                let written = &shaker.output.writes[writes..];
                let moved = after.amplitude_nanometre.abs_diff(before.amplitude_nanometre);
                // Never faster than the greatest rate (20 mm/s at 500 Hz are 40 µm a tick), but for
                // a cut-off.
                prop_assert!(moved <= 40_000 || shaker.state() == ShakerState::Faulted);
                prop_assert!(written.iter().all(|y| y.unsigned_abs() <= before.amplitude_nanometre));
                prop_assert!(moving || written.iter().all(|&y| y == 0));
                prop_assert!(shaker.moving() || after.phase_increment == 0);
                prop_assert!(shaker.moving() || after.amplitude_nanometre == 0);
                if !shaker.output.fail_enable {
                    let on = shaker.moving() || shaker.state() == ShakerState::Armed;
                    prop_assert!(on || !shaker.output.enabled, "{:?}", shaker.state());
                }
            }
        }
        // Left alone, it comes to rest.
        shaker.output.fail_write = false;
        shaker.output.fail_enable = false;
        alone(&mut shaker, 70 * 500);
        while shaker.moving() {
            // The slowest ramp that was set may take longer.
            alone(&mut shaker, 500);
        }
        prop_assert!(matches!(shaker.state(), ShakerState::Disarmed | ShakerState::Faulted));
        prop_assert_eq!(shaker.output.writes.last(), Some(&0));
    }
}
