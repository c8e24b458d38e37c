//! `rtt[:CHIP]`: the stream through a debug probe: RTT channel 1 up, channel 0 down.
//!
//! The firmware's messages for people are channel 0 up, which is left alone. Reading halts nothing:
//! the probe reads the target's memory while it runs.

use super::source::{SourceKind, bad};

#[cfg(not(feature = "probe"))]
pub(super) const KIND: SourceKind = SourceKind {
    id: "rtt",
    form: "rtt[:CHIP]",
    about: "through a debug probe (needs a build with --features probe)",
    parse: |argument, _| {
        Err(bad(
            &argument.map_or("rtt".to_owned(), |chip| format!("rtt:{chip}")),
            "a whirl built with --features probe",
        )
        .remedy("Build it with `cargo build --release --features probe`, or use serial:/dev/ttyACM0"))
    },
};

#[cfg(feature = "probe")]
pub(super) const KIND: SourceKind = SourceKind {
    id: "rtt",
    form: "rtt[:CHIP]",
    about: "through a debug probe; STM32G474RETx where no chip is given",
    parse: |argument, _| {
        let chip = argument.unwrap_or("STM32G474RETx");
        if chip.is_empty() || !chip.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_".contains(&b)) {
            return Err(bad(&format!("rtt:{chip}"), "a chip's name").remedy("Such as rtt:STM32F446RETx"));
        }
        Ok(Box::new(with_probe::Rtt::new(chip)))
    },
};

#[cfg(feature = "probe")]
mod with_probe {
    use std::io;
    use std::time::{Duration, Instant};

    use probe_rs::rtt::Rtt as Channels;
    use probe_rs::{Session, SessionConfig};

    use super::super::source::{Link, Source};

    /// Channel of the product's stream, up.
    const UP: usize = 1;
    /// Channel of the host's bytes, down.
    const DOWN: usize = 0;
    /// A read waits for so long.
    const WAIT: Duration = Duration::from_millis(50);
    /// Time for the target to take a command: its thread looks every millisecond.
    const TAKE: Duration = Duration::from_secs(1);
    /// Time between two looks.
    const NAP: Duration = Duration::from_millis(2);

    pub(super) struct Rtt {
        chip: String,
    }

    impl Rtt {
        pub(super) fn new(chip: &str) -> Self {
            Self { chip: chip.to_owned() }
        }
    }

    impl Source for Rtt {
        fn open(&mut self) -> io::Result<Box<dyn Link>> {
            let mut session =
                Session::auto_attach(self.chip.as_str(), SessionConfig::default()).map_err(io::Error::other)?;
            let channels = {
                let mut core = session.core(0).map_err(io::Error::other)?;
                Channels::attach(&mut core).map_err(io::Error::other)?
            };
            let mut probe = Probe { session, channels };
            if probe.channels.up_channel(UP).is_none() || probe.channels.down_channel(DOWN).is_none() {
                return Err(io::Error::other("the target's firmware has no RTT channels of whirl's"));
            }
            Ok(Box::new(probe))
        }

        fn remedy(&self) -> String {
            format!(
                "Plug the board in by its debug probe, with whirl's firmware on a {}; see docs/boards.md",
                self.chip
            )
        }
    }

    struct Probe {
        session: Session,
        channels: Channels,
    }

    impl Link for Probe {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let since = Instant::now();
            loop {
                let mut core = self.session.core(0).map_err(io::Error::other)?;
                let Some(channel) = self.channels.up_channel(UP) else {
                    return Err(io::ErrorKind::NotConnected.into());
                };
                let n = channel.read(&mut core, buffer).map_err(io::Error::other)?;
                if n > 0 {
                    return Ok(n);
                }
                if since.elapsed() > WAIT {
                    return Err(io::ErrorKind::TimedOut.into());
                }
                drop(core);
                std::thread::sleep(NAP);
            }
        }

        fn write_all(&mut self, mut bytes: &[u8]) -> io::Result<()> {
            let since = Instant::now();
            while !bytes.is_empty() {
                let mut core = self.session.core(0).map_err(io::Error::other)?;
                let Some(channel) = self.channels.down_channel(DOWN) else {
                    return Err(io::ErrorKind::NotConnected.into());
                };
                let n = channel.write(&mut core, bytes).map_err(io::Error::other)?;
                bytes = &bytes[n.min(bytes.len())..];
                if n == 0 && since.elapsed() > TAKE {
                    return Err(io::Error::other("the target takes no commands"));
                }
                drop(core);
                if !bytes.is_empty() {
                    std::thread::sleep(NAP);
                }
            }
            Ok(())
        }
    }
}
