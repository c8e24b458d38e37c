//! A pair of connected ends within one process, like a serial line without a driver.
//!
//! Each direction holds a bounded number of bytes: a full one blocks its writer until the other end
//! reads. When an end is dropped the other one reads what is left and then 0 bytes, and its writes
//! fail with `BrokenPipe`.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::Duration;

#[derive(Debug, Default)]
struct Channel {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    bytes: VecDeque<u8>,
    closed: bool,
}

impl Channel {
    fn lock(&self) -> MutexGuard<'_, State> {
        // A poisoned lock means that the other thread panicked between two whole changes: the bytes
        // are in order.
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }

    fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }
}

/// One end.
#[derive(Debug)]
pub struct PipeEnd {
    incoming: Arc<Channel>,
    outgoing: Arc<Channel>,
    capacity: usize,
    timeout: Option<Duration>,
}

/// Two connected ends; each direction holds at most `capacity` bytes (at least 1).
pub fn pipe(capacity: usize) -> (PipeEnd, PipeEnd) {
    let (there, back) = (Arc::new(Channel::default()), Arc::new(Channel::default()));
    let capacity = capacity.max(1);
    let first = PipeEnd { incoming: Arc::clone(&back), outgoing: Arc::clone(&there), capacity, timeout: None };
    (first, PipeEnd { incoming: there, outgoing: back, capacity, timeout: None })
}

impl PipeEnd {
    /// Longest time that a read or a write waits before it fails with `TimedOut`; `None` for ever.
    pub fn set_timeout(&mut self, timeout: Option<Duration>) {
        self.timeout = timeout;
    }

    fn wait<'a>(&self, channel: &'a Channel, state: MutexGuard<'a, State>) -> io::Result<MutexGuard<'a, State>> {
        use std::sync::PoisonError;
        let Some(timeout) = self.timeout else {
            return Ok(channel.changed.wait(state).unwrap_or_else(PoisonError::into_inner));
        };
        let (state, result) = channel.changed.wait_timeout(state, timeout).unwrap_or_else(PoisonError::into_inner);
        if result.timed_out() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        Ok(state)
    }
}

impl Read for PipeEnd {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        let mut state = self.incoming.lock();
        while state.bytes.is_empty() {
            if state.closed {
                return Ok(0);
            }
            state = self.wait(&self.incoming, state)?;
        }
        let n = state.bytes.read(buffer)?;
        self.incoming.changed.notify_all();
        Ok(n)
    }
}

impl Write for PipeEnd {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let mut state = self.outgoing.lock();
        loop {
            if state.closed {
                return Err(io::ErrorKind::BrokenPipe.into());
            }
            let room = self.capacity - state.bytes.len().min(self.capacity);
            if room > 0 {
                let n = room.min(bytes.len());
                state.bytes.extend(&bytes[..n]);
                self.outgoing.changed.notify_all();
                return Ok(n);
            }
            state = self.wait(&self.outgoing, state)?;
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for PipeEnd {
    fn drop(&mut self) {
        self.outgoing.close();
        self.incoming.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_pass_both_ways_through_a_narrow_pipe() {
        let (mut near, mut far) = pipe(7);
        let sent: Vec<u8> = (0..10_000_u32).map(|i| i as u8).collect();
        let expected = sent.clone();
        let writer = std::thread::spawn(move || {
            near.write_all(&sent).unwrap();
            let mut answer = [0; 2];
            near.read_exact(&mut answer).unwrap();
            answer
        });
        let mut got = vec![0; expected.len()];
        far.read_exact(&mut got).unwrap();
        far.write_all(b"ok").unwrap();
        assert_eq!(got, expected);
        assert_eq!(&writer.join().unwrap(), b"ok");
    }

    #[test]
    fn a_dropped_end_is_the_end() {
        let (mut near, far) = pipe(100);
        near.write_all(b"last").unwrap();
        let mut far = far;
        let mut buffer = [0; 10];
        drop(near);
        assert_eq!(far.read(&mut buffer).unwrap(), 4);
        assert_eq!(far.read(&mut buffer).unwrap(), 0);
        assert_eq!(far.write(b"x").unwrap_err().kind(), io::ErrorKind::BrokenPipe);
    }

    #[test]
    fn reads_and_writes_time_out() {
        let (mut near, _far) = pipe(4);
        near.set_timeout(Some(Duration::from_millis(5)));
        assert_eq!(near.read(&mut [0; 4]).unwrap_err().kind(), io::ErrorKind::TimedOut);
        assert_eq!(near.write(b"abcdef").unwrap(), 4);
        assert_eq!(near.write(b"g").unwrap_err().kind(), io::ErrorKind::TimedOut);
    }
}
