//! A rig that is read and written like a port, in the caller's own thread and without any clock.
//!
//! A read that finds nothing waiting runs the rig until it sends something (at most a second of the
//! rig's time, after which the read times out); a write is heard at the rig's next tick. Runs
//! repeat byte by byte.

use std::collections::VecDeque;
use std::io::{self, Read, Write};

use crate::faults::FaultyLink;
use crate::virtual_rig::VirtualRig;

/// A rig as a port.
#[derive(Debug)]
pub struct LockStep {
    rig: VirtualRig,
    faults: Option<FaultyLink>,
    waiting: VecDeque<u8>,
}

impl LockStep {
    /// A port to a rig, through a faulty link if one is given.
    pub fn new(rig: VirtualRig, faults: Option<FaultyLink>) -> Self {
        Self { rig, faults, waiting: VecDeque::new() }
    }

    /// The rig.
    pub fn rig(&self) -> &VirtualRig {
        &self.rig
    }

    /// The rig, to make it miss ticks or restart.
    pub fn rig_mut(&mut self) -> &mut VirtualRig {
        &mut self.rig
    }

    /// The link's faults.
    pub fn faults(&self) -> Option<&FaultyLink> {
        self.faults.as_ref()
    }

    /// The link's faults, to unplug it.
    pub fn faults_mut(&mut self) -> Option<&mut FaultyLink> {
        self.faults.as_mut()
    }

    /// Ends the line: the rig stands still, what the link held back can be read, and the link's
    /// account is complete. What the device has queued but not sent is not part of it.
    pub fn finish(&mut self) -> Vec<u8> {
        self.carry();
        if let Some(faults) = &mut self.faults {
            self.waiting.extend(faults.finish());
        }
        self.waiting.drain(..).collect()
    }

    fn carry(&mut self) {
        let sent = self.rig.take_output();
        match &mut self.faults {
            Some(faults) => self.waiting.extend(faults.push(&sent)),
            None => self.waiting.extend(sent),
        }
    }
}

impl Read for LockStep {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        let second = (1.0 / self.rig.tick_s()).ceil() as u64;
        let end = self.rig.ticks().saturating_add(second.max(1));
        while self.waiting.is_empty() {
            if self.rig.ticks() >= end {
                return Err(io::Error::new(io::ErrorKind::TimedOut, "the rig sent nothing for a second of its time"));
            }
            self.rig.step().map_err(io::Error::other)?;
            self.carry();
        }
        self.waiting.read(buffer)
    }
}

impl Write for LockStep {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.rig.give_input(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::FaultSettings;
    use crate::virtual_rig::RigSettings;

    fn port(faults: Option<FaultyLink>) -> LockStep {
        LockStep::new(VirtualRig::new(&RigSettings::default()).unwrap(), faults)
    }

    fn read(port: &mut LockStep, bytes: usize) -> Vec<u8> {
        let mut all = Vec::new();
        let mut buffer = [0; 64];
        while all.len() < bytes {
            let n = port.read(&mut buffer).unwrap();
            all.extend_from_slice(&buffer[..n]);
        }
        all
    }

    #[test]
    fn reading_runs_the_rig_and_runs_repeat() {
        let mut first = port(None);
        let bytes = read(&mut first, 20_000);
        assert!(first.rig().ticks() > 2_000);
        assert_eq!(bytes, read(&mut port(None), 20_000));
        assert_eq!(first.read(&mut []).unwrap(), 0);
    }

    #[test]
    fn faults_are_in_the_line_and_a_dead_line_times_out() {
        let link = FaultyLink::new(FaultSettings { drop_frame: 0.1, ..FaultSettings::default() }, 1);
        let mut port = port(Some(link));
        assert!(read(&mut port, 20_000).len() >= 20_000);
        port.faults_mut().unwrap().unplug();
        let mut rest = [0; 4096];
        let error = loop {
            match port.read(&mut rest) {
                Ok(n) => assert!(n > 0),
                Err(error) => break error,
            }
        };
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        port.faults_mut().unwrap().replug();
        assert!(read(&mut port, 2_000).len() >= 2_000);
        port.finish();
        let report = port.faults().unwrap().report();
        assert!(report.samples.vanished > 500 && report.samples.survived > 1_000, "{report:?}");
    }
}
