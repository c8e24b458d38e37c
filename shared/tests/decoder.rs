//! The decoder under seeded damage, in the time of an ordinary test; `examples/decoder_torture.rs`
//! runs longer.

mod support;

use proptest::prelude::*;
use support::{Account, Source, torture};
use whirl_shared::codec::{Decoder, FrameError, MAX_FRAME, encode};
use whirl_shared::frame::{DeviceMessage, HostMessage};

fn check(account: Account, bytes: u64) {
    assert!(account.bytes >= bytes);
    assert_eq!(account.intact_sent, account.intact_received);
    // The run is worth its name only if each kind of frame was frequent.
    assert!(account.intact_sent > bytes / 2_000 && account.bad > bytes / 2_000, "{account:?}");
}

#[test]
fn five_million_bytes_of_damage_to_what_the_device_sends() {
    check(torture::<DeviceMessage>(1, 5_000_000, Source::device), 5_000_000);
}

#[test]
fn five_million_bytes_of_damage_to_what_the_host_sends() {
    check(torture::<HostMessage>(2, 5_000_000, Source::host), 5_000_000);
}

#[test]
fn the_same_seed_gives_the_same_account() {
    let run = |seed| torture::<DeviceMessage>(seed, 50_000, Source::device);
    assert_eq!(run(5), run(5));
    assert_ne!(run(5).digest, run(6).digest);
}

proptest! {
    #[test]
    fn every_message_comes_back(seed in any::<u64>()) {
        let mut source = Source::new(seed);
        let (device, host) = (source.device(), source.host());
        let mut out = [0; MAX_FRAME];

        let length = encode(&device, &mut out).unwrap();
        prop_assert!(!out[..length - 1].contains(&0) && out[length - 1] == 0);
        let mut decoder: Decoder<DeviceMessage> = Decoder::new();
        let got: Vec<_> = out[..length].iter().filter_map(|&byte| decoder.push(byte)).collect();
        prop_assert_eq!(got, vec![Ok(device)]);

        let length = encode(&host, &mut out).unwrap();
        let mut decoder: Decoder<HostMessage> = Decoder::new();
        let got: Vec<_> = out[..length].iter().filter_map(|&byte| decoder.push(byte)).collect();
        prop_assert_eq!(got, vec![Ok(host)]);
    }

    /// A single flipped bit is always noticed: as an error, or (where it makes or removes a zero)
    /// as several.
    #[test]
    fn one_flipped_bit_never_gives_a_message(seed in any::<u64>(), place in any::<proptest::sample::Index>(), bit in 0_u8..8) {
        let envelope = Source::new(seed).device();
        let mut out = [0; MAX_FRAME];
        let length = encode(&envelope, &mut out).unwrap();
        out[place.index(length)] ^= 1_u8 << bit;
        let mut decoder: Decoder<DeviceMessage> = Decoder::new();
        let results = out[..length].iter().chain(&[0]).filter_map(|&byte| decoder.push(byte));
        let results: Vec<Result<_, FrameError>> = results.collect();
        prop_assert!(!results.is_empty() && results.iter().all(Result::is_err), "{:?}", results);
    }

    #[test]
    fn any_bytes_are_harmless(bytes in proptest::collection::vec(any::<u8>(), 0..4_096)) {
        let mut decoder: Decoder<DeviceMessage, 16> = Decoder::new();
        for byte in bytes {
            decoder.push(byte);
        }
    }
}
