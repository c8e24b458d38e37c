//! A rig behind a listening socket.
//!
//! One client at a time: while one is connected others are turned away; when it has gone the next
//! may come, and it begins in the middle of the stream. The socket's send buffer is kept small, so
//! that a slow client is noticed soon.

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};

use super::{Transport, is_later};

/// Send buffer asked for, bytes (about two seconds of samples; systems round it up).
const SEND_BUFFER: usize = 8192;

/// The socket.
#[derive(Debug)]
pub struct TcpServer {
    listener: TcpListener,
    client: Option<TcpStream>,
    unplugged: bool,
}

impl TcpServer {
    /// Listens at an address (port 0: one that is free, see [`Self::address`]).
    ///
    /// # Errors
    /// An address that cannot be listened at.
    pub fn bind(address: impl ToSocketAddrs) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, client: None, unplugged: false })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// Where the system does not tell.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    fn prepare(stream: &TcpStream) -> io::Result<()> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        #[cfg(unix)]
        rustix::net::sockopt::set_socket_send_buffer_size(stream, SEND_BUFFER)?;
        Ok(())
    }

    /// What an attempt on the client gave; a client that fails is gone.
    fn outcome(&mut self, result: io::Result<usize>) -> usize {
        match result {
            Ok(n) => n,
            Err(error) if is_later(&error) => 0,
            Err(_) => {
                self.client = None;
                0
            }
        }
    }
}

impl Transport for TcpServer {
    fn connected(&self) -> bool {
        self.client.is_some()
    }

    fn maintain(&mut self) -> io::Result<()> {
        if let Some(client) = &self.client {
            // A client that has closed reads as an end.
            match client.peek(&mut [0]) {
                Ok(0) => self.client = None,
                Err(error) if !is_later(&error) => self.client = None,
                _ => {}
            }
        }
        loop {
            match self.listener.accept() {
                Ok((stream, _)) => {
                    // Dropping a stream turns its client away; so does one that cannot be prepared.
                    if !self.unplugged && self.client.is_none() && Self::prepare(&stream).is_ok() {
                        self.client = Some(stream);
                    }
                }
                // Whatever else happened to one that tried to connect is not ours to mend.
                Err(_) => return Ok(()),
            }
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(client) = &mut self.client else { return Ok(0) };
        let result = client.write(bytes);
        Ok(self.outcome(result))
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some(client) = &mut self.client else { return Ok(0) };
        let result = client.read(buffer);
        if matches!(result, Ok(0)) {
            self.client = None;
        }
        Ok(self.outcome(result))
    }

    fn unplug(&mut self) {
        self.unplugged = true;
        self.client = None;
    }

    fn replug(&mut self) -> io::Result<()> {
        self.unplugged = false;
        Ok(())
    }
}
