//! A rig behind a pseudo-terminal, which a host opens as it opens a serial port.
//!
//! The terminal is raw from the start (no echo, no translation). Its name changes with every pair,
//! so a symbolic link of a fixed name points to it. Unplugging closes the pair and takes the link
//! away: a host that has it open gets an error (`EIO` or an end), a host that opens it finds
//! nothing, as with a USB adapter. Replugging makes a new pair under the same link.
//!
//! A pseudo-terminal does not tell whether anybody has it open: it counts as connected while it is
//! plugged in, and what nobody reads fills the system's buffer (4 kB on Linux), after which nothing
//! more goes.

use std::fs::File;
use std::io::{self, Read, Write};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use super::{Transport, is_later};

/// The pair.
#[derive(Debug)]
struct Pair {
    controller: File,
    /// Kept open so that the line does not end whenever a host closes it.
    _user: OwnedFd,
}

/// The terminal and its link.
#[derive(Debug)]
pub struct PseudoTerminal {
    link: PathBuf,
    pair: Option<Pair>,
}

impl PseudoTerminal {
    /// Makes a terminal that is found at `link`. A symbolic link that is there is replaced;
    /// anything else is left alone.
    ///
    /// # Errors
    /// No terminal to be had, or something other than a symbolic link at `link`.
    pub fn new(link: impl Into<PathBuf>) -> io::Result<Self> {
        let mut terminal = Self { link: link.into(), pair: None };
        terminal.plug_in()?;
        Ok(terminal)
    }

    /// Where a host finds it.
    pub fn path(&self) -> &Path {
        &self.link
    }

    fn remove_link(&self) -> io::Result<()> {
        match std::fs::symlink_metadata(&self.link) {
            Ok(found) if found.file_type().is_symlink() => std::fs::remove_file(&self.link),
            Ok(_) => Err(io::Error::new(
                io::ErrorKind::AlreadyExists,
                format!("{} exists and is no symbolic link", self.link.display()),
            )),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            Err(error) => Err(error),
        }
    }

    fn plug_in(&mut self) -> io::Result<()> {
        let pair = rustix_openpty::openpty(None, None)?;
        let mut settings = tcgetattr(&pair.user)?;
        settings.make_raw();
        tcsetattr(&pair.user, OptionalActions::Now, &settings)?;
        fcntl_setfl(&pair.controller, fcntl_getfl(&pair.controller)? | OFlags::NONBLOCK)?;
        let name = rustix::termios::ttyname(&pair.user, Vec::new())?;
        let name = name.into_string().map_err(|_| io::Error::other("the terminal's name is not UTF-8"))?;
        self.remove_link()?;
        std::os::unix::fs::symlink(name, &self.link)?;
        self.pair = Some(Pair { controller: File::from(pair.controller), _user: pair.user });
        Ok(())
    }

    fn outcome(result: io::Result<usize>) -> io::Result<usize> {
        match result {
            Ok(n) => Ok(n),
            Err(error) if is_later(&error) => Ok(0),
            Err(error) => Err(error),
        }
    }
}

impl Transport for PseudoTerminal {
    fn connected(&self) -> bool {
        self.pair.is_some()
    }

    fn maintain(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(pair) = &mut self.pair else { return Ok(0) };
        Self::outcome(pair.controller.write(bytes))
    }

    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some(pair) = &mut self.pair else { return Ok(0) };
        Self::outcome(pair.controller.read(buffer))
    }

    fn unplug(&mut self) {
        // What lies at the link's place may have changed; the terminal goes in any case.
        let _ = self.remove_link();
        self.pair = None;
    }

    fn replug(&mut self) -> io::Result<()> {
        if self.pair.is_none() { self.plug_in() } else { Ok(()) }
    }
}

impl Drop for PseudoTerminal {
    fn drop(&mut self) {
        self.unplug();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("whirl-{name}-{}", std::process::id()))
    }

    #[test]
    fn bytes_pass_unchanged_and_unplugging_ends_the_line() {
        let link = place("pty");
        let mut terminal = PseudoTerminal::new(&link).unwrap();
        let open = || File::options().read(true).write(true).open(&link);
        let all: Vec<u8> = (0..=255).collect();
        for _ in 0..2 {
            let mut port = open().unwrap();
            assert_eq!(terminal.send(&all).unwrap(), 256);
            let mut got = vec![0; 256];
            port.read_exact(&mut got).unwrap();
            assert_eq!(got, all);
            port.write_all(&all).unwrap();
            let mut heard = Vec::new();
            let mut buffer = [0; 300];
            while heard.len() < 256 {
                let n = terminal.receive(&mut buffer).unwrap();
                heard.extend_from_slice(&buffer[..n]);
            }
            assert_eq!(heard, all);
            terminal.unplug();
            assert!(matches!(port.read(&mut buffer), Err(_) | Ok(0)));
            assert!(port.write_all(&all).is_err());
            assert!(open().is_err());
            assert_eq!(terminal.send(&all).unwrap(), 0);
            terminal.replug().unwrap();
        }
        drop(terminal);
        assert!(std::fs::symlink_metadata(&link).is_err());
    }

    #[test]
    fn a_file_in_the_link_s_place_is_left_alone() {
        let link = place("file");
        std::fs::write(&link, b"mine").unwrap();
        let error = PseudoTerminal::new(&link).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read(&link).unwrap(), b"mine");
        std::fs::remove_file(&link).unwrap();
    }

    #[test]
    fn what_nobody_reads_stops_the_line_and_does_not_block() {
        let link = place("full");
        let mut terminal = PseudoTerminal::new(&link).unwrap();
        let mut sent = 0;
        loop {
            let n = terminal.send(&[1; 1024]).unwrap();
            if n == 0 {
                break;
            }
            sent += n;
            assert!(sent < 1 << 20);
        }
    }
}
