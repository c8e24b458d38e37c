//! `tcp:HOST:PORT`: a device's stream over TCP (an emulated board, a serial-to-network bridge).

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use super::source::{Link, Source, SourceKind, bad};

pub(super) const KIND: SourceKind = SourceKind {
    id: "tcp",
    form: "tcp:HOST:PORT",
    about: "a stream over TCP",
    parse: |argument, _| {
        let text = argument.unwrap_or_default();
        match text.rsplit_once(':') {
            Some((host, port)) if !host.is_empty() && port.parse::<u16>().is_ok_and(|p| p > 0) => {
                Ok(Box::new(Tcp { address: text.to_owned() }))
            }
            _ => Err(bad(text, "HOST:PORT").remedy("Such as tcp:localhost:5000")),
        }
    },
};

struct Tcp {
    address: String,
}

struct Stream(TcpStream);

impl Source for Tcp {
    fn open(&mut self) -> io::Result<Box<dyn Link>> {
        let mut last = io::Error::new(io::ErrorKind::NotFound, "the host has no address");
        for address in self.address.to_socket_addrs()? {
            match TcpStream::connect_timeout(&address, Duration::from_secs(3)) {
                Ok(stream) => {
                    stream.set_nodelay(true)?;
                    stream.set_read_timeout(Some(Duration::from_millis(50)))?;
                    stream.set_write_timeout(Some(Duration::from_secs(1)))?;
                    return Ok(Box::new(Stream(stream)));
                }
                Err(e) => last = e,
            }
        }
        Err(last)
    }

    fn remedy(&self) -> String {
        format!("See that something listens at {}", self.address)
    }
}

impl Link for Stream {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.0.read(buffer)
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.write_all(bytes)
    }
}
