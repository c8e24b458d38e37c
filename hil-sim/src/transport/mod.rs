//! Ways to the virtual rig: one file each.
//!
//! | file | what | who waits for whom |
//! |---|---|---|
//! | `lock_step` | `Read + Write` on the rig itself, in the caller's thread | a read runs the rig until there is output: deterministic, as fast as it can |
//! | `pipe` | a pair of `Read + Write` ends between threads | a full pipe blocks its writer |
//! | `tcp` | a listening socket, one client at a time | see [`server`] |
//! | `pty` | a pseudo-terminal behind a stable symbolic link | see [`server`] |
//!
//! [`server`] runs a rig behind a [`Transport`], paced by the clock or by the client.

pub mod lock_step;
pub mod pipe;
#[cfg(unix)]
pub mod pty;
pub mod server;
pub mod tcp;

use std::io;

/// A line to at most one host that never blocks.
pub trait Transport: Send {
    /// Whether a host may be listening.
    fn connected(&self) -> bool;

    /// Takes care of connections; to be called often.
    ///
    /// # Errors
    /// What makes the transport useless for good.
    fn maintain(&mut self) -> io::Result<()>;

    /// Sends as many of the bytes as go now; 0 where none do, or where nobody is connected.
    ///
    /// # Errors
    /// What makes the transport useless for good. That a host has gone is no error.
    fn send(&mut self, bytes: &[u8]) -> io::Result<usize>;

    /// Bytes that the host has sent; 0 where there are none now.
    ///
    /// # Errors
    /// As for [`Self::send`].
    fn receive(&mut self, buffer: &mut [u8]) -> io::Result<usize>;

    /// Pulls the plug: the host sees the line die.
    fn unplug(&mut self);

    /// Plugs in again.
    ///
    /// # Errors
    /// Where the line cannot be made anew.
    fn replug(&mut self) -> io::Result<()>;
}

/// Whether an error of a connection means that nothing goes at this moment.
fn is_later(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
}
