//! Every sample behind a faulty link is accounted for.

use whirl_tests::accuracy::{chaotic_rig, measured_base_rig};
use whirl_tests::faulty::capture;

/// Simulated time, s: 1.8 million samples of both arms and the base.
const SECONDS: f64 = 3600.0;

#[test]
fn every_sample_of_a_long_capture_through_every_fault_is_accounted_for() {
    let account = capture(&measured_base_rig(), SECONDS, 7);
    let l = &account.outcome.losses;
    assert_eq!(l.received + l.lost_on_link + l.damaged + l.overruns + l.dropped_by_device, account.ticks, "{l:?}");
    assert!(account.ticks as f64 >= SECONDS * 500.0, "{}", account.ticks);
    assert_eq!(account.disagreements, 0, "against the injector's own account, tick by tick");
    // Each kind of fault was there.
    let drawn = &account.injected;
    assert!(drawn.drawn_frames.iter().chain(&drawn.drawn_bytes).all(|n| *n > 0) && drawn.unplugged > 0, "{drawn:?}");
    assert!(drawn.samples.damaged > 0 && drawn.samples.vanished > 0 && l.duplicates > 0, "{l:?}");
    // The device has sent again what was lost; the unpluggings are shorter than what it keeps.
    assert!(l.restored > 10_000 && l.lost() < 200, "{l:?}");
    assert_eq!((l.restarts, l.overruns, l.dropped_by_device), (0, 0, 0));
}

#[test]
fn a_frame_that_a_new_link_makes_whole_is_in_both_accounts() {
    // The plug was pulled before a frame's closing zero alone, and the capture opened the link anew
    // behind it.
    let account = capture(&chaotic_rig(5.0), 360.0, 72);
    let l = &account.outcome.losses;
    assert!(account.outcome.reconnections > 0 && account.disagreements == 0, "{}", account.disagreements);
    assert_eq!(l.received + l.lost(), account.ticks, "{l:?}");
}
