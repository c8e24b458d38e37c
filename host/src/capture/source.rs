//! Where a capture's bytes come from: one file a source and one line in [`SOURCES`].

use std::io;
use std::time::{Duration, Instant};

use super::{file, rtt, serial, sim, tcp};
use crate::error::{BadInput, Result};
use crate::rig::Rig;

/// An open connection to a device (or to what stands for one).
pub trait Link: Send {
    /// Reads what is there. `Ok(0)` says that the stream has ended; an error of kind `TimedOut` or
    /// `WouldBlock` that nothing came for now (a call waits 100 ms at most); any other that the
    /// connection is gone.
    ///
    /// # Errors
    /// As above.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize>;

    /// Sends bytes to the device.
    ///
    /// # Errors
    /// The connection is gone.
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()>;
}

/// Something that can be connected to, again and again.
pub trait Source: Send {
    /// Connects.
    ///
    /// # Errors
    /// The connection cannot be made now.
    fn open(&mut self) -> io::Result<Box<dyn Link>>;

    /// Where its bytes were recorded before: nothing is sent, its end is the end, and no journal is
    /// kept.
    fn is_replay(&self) -> bool {
        false
    }

    /// The time by which the device lives; a simulated one brings its own, so that a run is the
    /// same at every repeat.
    fn now(&self) -> Instant {
        Instant::now()
    }

    /// Lets time go by.
    fn pause(&mut self, time: Duration) {
        std::thread::sleep(time);
    }

    /// Whether it is simulated: its record then carries no date.
    fn is_simulated(&self) -> bool {
        false
    }

    /// Time for which the drive (or, without one, the rig) is left to itself before recording, s.
    fn settle_s(&self) -> f64 {
        0.0
    }

    /// What it gives goes on in the record of an earlier session: a simulated device has restarted
    /// since.
    fn resumed(&mut self) {}

    /// Why it will never send again, where that is known: nothing is tried again then.
    fn failed(&self) -> Option<BadInput> {
        None
    }

    /// What to do where it cannot be opened.
    fn remedy(&self) -> String;
}

/// Makes a source from what stands behind the colon (none where there is no colon).
pub type Parse = fn(Option<&str>, &Rig) -> Result<Box<dyn Source>>;

/// A kind of source.
pub struct SourceKind {
    /// What stands before the colon.
    pub id: &'static str,
    /// Its form, for messages and lists.
    pub form: &'static str,
    /// What it is.
    pub about: &'static str,
    /// Makes one.
    pub parse: Parse,
}

/// Every kind of source.
pub static SOURCES: &[SourceKind] = &[serial::KIND, tcp::KIND, sim::KIND, file::KIND, rtt::KIND];

/// The forms of all sources, for messages.
pub fn forms() -> String {
    SOURCES.iter().map(|s| s.form).collect::<Vec<_>>().join(", ")
}

/// Makes the source that `text` names.
///
/// # Errors
/// A source of no known form; what the source itself says of its argument.
pub fn parse(text: &str, rig: &Rig) -> Result<Box<dyn Source>> {
    let (id, argument) = match text.split_once(':') {
        Some((id, argument)) => (id, Some(argument)),
        None => (text, None),
    };
    let Some(kind) = SOURCES.iter().find(|s| s.id == id) else {
        return Err(bad(text, &format!("one of {}", forms())).remedy("A port is named as serial:/dev/ttyACM0"));
    };
    (kind.parse)(argument, rig)
}

/// An error in the text of a source.
pub(super) fn bad(found: &str, expected: &str) -> BadInput {
    BadInput::new(format!("\"{found}\""), expected).at("--from")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_sources_are_told_the_forms() {
        let text = "name = \"x\"\nmodel = \"double-pendulum\"\nsample_rate_hz = 500.0\n[[channel]]\nname = \"a\"\n\
            measures = \"theta1\"\nunit = \"rad\"\n";
        let rig = Rig::parse(text, std::path::Path::new("rig.toml")).unwrap();
        for (from, part) in [
            ("usb", "serial:/dev/ttyACM0[@BAUD]"),
            ("/dev/ttyACM0", "serial:/dev/ttyACM0"),
            ("serial:", "a port"),
            ("serial:/dev/ttyACM0@fast", "a baud rate"),
            ("serial:/dev/ttyACM0@0", "a baud rate"),
            ("tcp:localhost", "HOST:PORT"),
            ("tcp:localhost:99999", "HOST:PORT"),
            ("file", "file:FRAMES"),
            #[cfg(not(feature = "probe"))]
            ("rtt", "--features probe"),
            #[cfg(feature = "probe")]
            ("rtt:a chip", "STM32F446RETx"),
        ] {
            let e = parse(from, &rig).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(e.contains(part) && e.contains("--from"), "{from}: {e}");
        }
        for from in ["serial:/dev/ttyACM0", "serial:/dev/ttyUSB1@921600", "tcp:[::1]:5000", "file:Cargo.toml"] {
            assert!(parse(from, &rig).is_ok(), "{from}");
        }
    }
}
