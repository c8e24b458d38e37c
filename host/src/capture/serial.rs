//! `serial:/dev/ttyACM0[@BAUD]`: a serial port, 8 data bits, no parity, 1 stop bit.

use std::io::{self, Read, Write};
use std::time::Duration;

use serialport::SerialPort;

use super::source::{Link, Source, SourceKind, bad};

/// Baud rate where none is given. A USB port ignores it.
pub const DEFAULT_BAUD: u32 = 115_200;

pub(super) const KIND: SourceKind = SourceKind {
    id: "serial",
    form: "serial:/dev/ttyACM0[@BAUD]",
    about: "a serial port, 115200 baud where not given",
    parse: |argument, _| {
        let text = argument.unwrap_or_default();
        let (port, baud) = match text.rsplit_once('@') {
            Some((port, baud)) => match baud.parse::<u32>() {
                Ok(baud) if (300..=50_000_000).contains(&baud) => (port, baud),
                _ => {
                    return Err(
                        bad(baud, "a baud rate from 300 to 50000000").remedy("Such as serial:/dev/ttyACM0@921600")
                    );
                }
            },
            None => (text, DEFAULT_BAUD),
        };
        if port.is_empty() {
            return Err(
                bad(text, "a port: serial:/dev/ttyACM0[@BAUD]").remedy("`ls /dev/ttyACM* /dev/ttyUSB*` shows them")
            );
        }
        Ok(Box::new(Serial { port: port.to_owned(), baud }))
    },
};

struct Serial {
    port: String,
    baud: u32,
}

struct Port(Box<dyn SerialPort>);

impl Source for Serial {
    fn open(&mut self) -> io::Result<Box<dyn Link>> {
        let port = serialport::new(&self.port, self.baud).timeout(Duration::from_millis(50));
        // A board on USB itself speaks to who sets DTR: opening a port does, but not on Windows.
        let port = if cfg!(windows) { port.dtr_on_open(true) } else { port };
        Ok(Box::new(Port(port.open().map_err(io::Error::from)?)))
    }

    fn remedy(&self) -> String {
        format!(
            "See that {} is the device's port (`ls /dev/ttyACM* /dev/ttyUSB*`), that you may use it (group dialout) and that no \
             other program has it open",
            self.port
        )
    }
}

impl Link for Port {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.write_all(bytes)
    }
}
