//! What the board's one light says, for people who look at it and not at a screen.
//!
//! | light | the board |
//! |---|---|
//! | a short flash a second | samples, and has not heard of a host since its time-out |
//! | on, with a short gap a second | samples, and a host is there |
//! | flashes twice a second | the shaker is armed: it may move |
//! | flashes five times a second | the shaker moves |
//! | three short flashes a second | the shaker is cut off after a fault |
//! | dark, or on without a gap | the firmware does not run |

use whirl_shared::frame::ShakerState;

/// Whether the light is on, `part` thousandths into a second.
#[must_use]
pub const fn on(state: ShakerState, host: bool, part: u32) -> bool {
    match state {
        ShakerState::Faulted => part < 600 && part % 200 < 80,
        ShakerState::Ramping | ShakerState::Running | ShakerState::Stopping => part % 200 < 100,
        ShakerState::Armed => part % 500 < 250,
        ShakerState::Disarmed if host => part >= 60,
        ShakerState::Disarmed => part < 60,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use std::vec::Vec;

    #[test]
    fn every_state_looks_different_and_none_is_steady() {
        let mut seen = BTreeSet::new();
        for (state, host) in [
            (ShakerState::Disarmed, false),
            (ShakerState::Disarmed, true),
            (ShakerState::Armed, true),
            (ShakerState::Running, true),
            (ShakerState::Faulted, true),
        ] {
            let second: Vec<bool> = (0..1_000).map(|part| on(state, host, part)).collect();
            assert!(second.contains(&true) && second.contains(&false), "{state:?}");
            assert!(seen.insert(second), "{state:?} looks like another");
        }
        for moving in [ShakerState::Ramping, ShakerState::Stopping] {
            assert!((0..1_000).all(|part| on(moving, true, part) == on(ShakerState::Running, true, part)));
        }
    }

    #[test]
    fn flashes_come_as_the_table_has_them() {
        // Flashes that begin in a second, and thousandths of it that are lit.
        for (state, host, flashes, lit) in [
            (ShakerState::Disarmed, false, 1, 60),
            (ShakerState::Disarmed, true, 1, 940),
            (ShakerState::Armed, true, 2, 500),
            (ShakerState::Running, true, 5, 500),
            (ShakerState::Faulted, true, 3, 240),
        ] {
            let begins = |part: u32| on(state, host, part) && !on(state, host, (part + 999) % 1_000);
            assert_eq!((0..1_000).filter(|&part| begins(part)).count(), flashes, "{state:?}");
            assert_eq!((0..1_000).filter(|&part| on(state, host, part)).count(), lit, "{state:?}");
        }
    }
}
