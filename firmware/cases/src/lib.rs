//! Cases that are run on the host, by `cargo test`, and on the emulated Cortex-M4F, each in a fresh
//! machine.
//!
//! The runner on the target is our own (`firmware/boards/mps2-an386/src/bin/cases.rs`,
//! `tests/tests/emulated/programs.rs`): the case's index goes in by semihosting's command line, the
//! exit status comes out. embedded-test 0.7 works by the same means, but its runner is probe-rs,
//! which drives a chip behind a debug probe; for QEMU it takes embedded-test-qemu-runner, a program
//! that would have to be installed beside cargo before any test can run. The macro below gives the
//! same cases to both sides without it.
//!
//! A case is a plain function that panics where it fails. What depends on rounding is compared by
//! its bits: both must compute the same.
#![no_std]

#[cfg(test)]
extern crate std;

mod accumulators;
mod estimation;
mod excitation;
mod link;
mod shaker;

/// Lists cases: names and functions in [`CASES`], and a `#[test]` for each on the host.
macro_rules! cases {
    ($($module:ident :: $case:ident),* $(,)?) => {
        /// Every case by its name.
        pub static CASES: &[(&str, fn())] = &[$((concat!(stringify!($module), "::", stringify!($case)), $module::$case)),*];

        #[cfg(test)]
        mod tests {
            $(#[test]
            fn $case() {
                super::$module::$case();
            })*
        }
    };
}

cases![
    link::every_message_survives_the_wire,
    link::every_flipped_bit_is_seen,
    link::the_decoder_finds_its_way_back,
    link::frame_numbers_tell_what_is_lost,
    accumulators::sums_have_the_same_bits,
    accumulators::phasors_do_not_drift,
    accumulators::the_waveform_has_the_same_bits,
    estimation::the_estimate_has_the_same_bits,
    estimation::a_locked_motion_is_not_identifiable,
    estimation::least_squares_find_what_they_were_given,
    shaker::nothing_moves_before_it_is_told_to,
    shaker::limits_are_kept_and_refusals_change_nothing,
    shaker::ramps_are_never_faster_than_set,
    shaker::silence_stops_it,
    excitation::sweeps_have_the_same_bits,
    excitation::several_sines_have_the_same_bits,
    excitation::steps_of_amplitude_have_the_same_bits,
    excitation::a_table_has_the_same_bits,
];
