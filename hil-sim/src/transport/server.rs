//! A rig that runs behind a transport in a thread of its own.
//!
//! | | [`Pace::RealTime`] | [`Pace::Client`] |
//! |---|---|---|
//! | the rig runs | with the clock, whoever listens | as fast as the client reads, and only while one is connected |
//! | nobody connected | it goes on; what it sends is lost, as on a serial line | it stands still |
//! | client too slow | [`crate::RigSettings::output_limit`] bytes are held, then the firmware's queue fills and counts its drops | the rig waits |
//! | client commands | act when they arrive | act when they arrive: up to the line's buffers later in the rig's time |
//!
//! The client's pace leaves the rig at most [`AHEAD`] bytes and the system's buffers ahead of the
//! client (tens of seconds of the rig's time): set the device's host time-out accordingly (60 s is
//! its greatest), and let the host send its signs of life by the rig's time, not the wall's.
//!
//! [`Server::unplug_for`] pulls the plug for so many ticks of the rig: the rig goes on meanwhile,
//! and what it sends is lost. A fault in the line itself is a [`FaultyLink`]; its account ends
//! where its bytes are handed to the transport, so what a pulled plug takes from the buffers behind
//! it is not in it.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::Transport;
use crate::error::SimulationError;
use crate::faults::{FaultReport, FaultyLink};
use crate::virtual_rig::VirtualRig;

/// Who sets the pace.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pace {
    /// The clock.
    RealTime,
    /// The client.
    #[default]
    Client,
}

/// Bytes that wait for a client at most, at the client's pace.
pub const AHEAD: usize = 2048;
/// Longest wait between two looks at the line.
const NAP: Duration = Duration::from_millis(1);
/// Time for which a pulled plug stays out at least, so that a host can see it.
const UNPLUGGED: Duration = Duration::from_millis(100);
/// Ticks that are caught up at once after the thread was kept from running; more are missed by the
/// sampler.
const CATCH_UP: u64 = 500;

/// Why a server ended.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The rig failed.
    #[error(transparent)]
    Rig(#[from] SimulationError),
    /// The line failed.
    #[error("the rig's line failed: {0}")]
    Line(#[from] io::Error),
    /// The thread could not be started or has panicked.
    #[error("the rig's thread failed")]
    Thread,
}

type Order = Box<dyn FnOnce(&mut VirtualRig) -> Result<(), SimulationError> + Send>;

enum Request {
    Rig(Order),
    Unplug(u64),
}

/// A running rig.
pub struct Server {
    stop: Arc<AtomicBool>,
    ticks: Arc<AtomicU64>,
    requests: Sender<Request>,
    faults: Arc<Mutex<FaultReport>>,
    thread: Option<JoinHandle<Result<(), ServerError>>>,
}

impl Server {
    /// Runs a rig behind a transport until [`Self::stop`] or drop.
    ///
    /// # Errors
    /// No thread to be had.
    pub fn start(
        rig: VirtualRig,
        transport: impl Transport + 'static,
        faults: Option<FaultyLink>,
        pace: Pace,
    ) -> Result<Self, ServerError> {
        let (stop, ticks) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let report = Arc::new(Mutex::new(FaultReport::default()));
        let (requests, orders) = channel();
        let mut worker = Worker {
            rig,
            line: Box::new(transport),
            faults,
            pace,
            waiting: Vec::new(),
            stop: Arc::clone(&stop),
            ticks: Arc::clone(&ticks),
            orders,
            report: Arc::clone(&report),
        };
        let thread = std::thread::Builder::new()
            .name("virtual rig".to_owned())
            .spawn(move || worker.run())
            .map_err(|_| ServerError::Thread)?;
        Ok(Self { stop, ticks, requests, faults: report, thread: Some(thread) })
    }

    /// Ticks of the rig since power-on.
    pub fn ticks(&self) -> u64 {
        self.ticks.load(Ordering::Relaxed)
    }

    /// Whether the rig is still running; if not, [`Self::stop`] tells why.
    pub fn is_running(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// Pulls the plug for so many ticks of the rig (and at least a tenth of a second of the
    /// wall's), then plugs in again.
    pub fn unplug_for(&self, ticks: u64) {
        // A rig that has ended has nothing to be unplugged.
        let _ = self.requests.send(Request::Unplug(ticks));
    }

    /// Does something to the rig between two ticks: makes it miss some, restart, fail.
    pub fn with_rig(&self, order: impl FnOnce(&mut VirtualRig) -> Result<(), SimulationError> + Send + 'static) {
        let _ = self.requests.send(Request::Rig(Box::new(order)));
    }

    /// Stops the rig and gives the account of the line's faults (empty without a faulty link).
    ///
    /// # Errors
    /// Why the rig had ended before.
    pub fn stop(mut self) -> Result<FaultReport, ServerError> {
        self.stop.store(true, Ordering::Relaxed);
        let thread = self.thread.take().ok_or(ServerError::Thread)?;
        thread.join().map_err(|_| ServerError::Thread)??;
        let report = self.faults.lock().map_err(|_| ServerError::Thread)?;
        Ok(report.clone())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // Nobody is left to be told how it ended.
            let _ = thread.join();
        }
    }
}

struct Worker {
    rig: VirtualRig,
    line: Box<dyn Transport>,
    faults: Option<FaultyLink>,
    pace: Pace,
    /// Bytes on their way to the client.
    waiting: Vec<u8>,
    stop: Arc<AtomicBool>,
    ticks: Arc<AtomicU64>,
    orders: Receiver<Request>,
    report: Arc<Mutex<FaultReport>>,
}

impl Worker {
    fn run(&mut self) -> Result<(), ServerError> {
        let result = self.serve();
        if let Some(faults) = &mut self.faults {
            faults.finish();
            if let Ok(mut report) = self.report.lock() {
                *report = faults.report().clone();
            }
        }
        result
    }

    fn serve(&mut self) -> Result<(), ServerError> {
        let start = Instant::now();
        let origin = self.rig.ticks();
        while !self.stop.load(Ordering::Relaxed) {
            self.line.maintain()?;
            let mut idle = !self.hear()?;
            while let Ok(request) = self.orders.try_recv() {
                match request {
                    Request::Rig(order) => order(&mut self.rig)?,
                    Request::Unplug(ticks) => self.unplugged(ticks)?,
                }
            }
            idle &= match self.pace {
                Pace::RealTime => self.follow_clock(start, origin)?,
                Pace::Client => self.follow_client()?,
            };
            idle &= !self.speak()?;
            if idle {
                std::thread::sleep(NAP);
            }
        }
        Ok(())
    }

    /// Hands bytes of the client to the rig. True if there were any.
    fn hear(&mut self) -> Result<bool, ServerError> {
        let mut buffer = [0; 1024];
        let n = self.line.receive(&mut buffer)?;
        self.rig.give_input(&buffer[..n]);
        Ok(n > 0)
    }

    fn step(&mut self) -> Result<(), ServerError> {
        self.rig.step()?;
        self.ticks.store(self.rig.ticks(), Ordering::Relaxed);
        Ok(())
    }

    /// Runs the ticks that are due. True if there were none.
    fn follow_clock(&mut self, start: Instant, origin: u64) -> Result<bool, ServerError> {
        let due = origin + (start.elapsed().as_secs_f64() / self.rig.tick_s()) as u64;
        let behind = due.saturating_sub(self.rig.ticks());
        if behind > CATCH_UP {
            // The thread was kept from running: the sampler has missed what a real one would have
            // missed.
            self.rig.miss_ticks(u32::try_from(behind - CATCH_UP).unwrap_or(u32::MAX));
        }
        for _ in 0..behind {
            self.step()?;
        }
        Ok(behind == 0)
    }

    /// Runs as long as the client keeps up. True if it does not.
    fn follow_client(&mut self) -> Result<bool, ServerError> {
        if !self.line.connected() || self.waiting.len() >= AHEAD {
            return Ok(true);
        }
        // A handful, so that the line is looked at often.
        for _ in 0..20 {
            self.step()?;
        }
        Ok(false)
    }

    /// Sends what waits. True if anything went.
    fn speak(&mut self) -> Result<bool, ServerError> {
        let connected = self.line.connected();
        // In real time a client that does not keep up leaves its bytes in the rig, which counts
        // what it must drop.
        if self.waiting.len() < AHEAD {
            let sent = self.rig.take_output();
            match &mut self.faults {
                Some(faults) => self.waiting.extend(faults.push(&sent)),
                None => self.waiting.extend(sent),
            }
        }
        if self.waiting.is_empty() {
            return Ok(false);
        }
        if !connected {
            if self.pace == Pace::RealTime {
                self.waiting.clear();
            }
            return Ok(false);
        }
        let n = self.line.send(&self.waiting)?;
        self.waiting.drain(..n);
        Ok(n > 0)
    }

    /// The plug is out: the rig runs on, and what it sends is lost.
    fn unplugged(&mut self, ticks: u64) -> Result<(), ServerError> {
        let since = Instant::now();
        self.line.unplug();
        if let Some(faults) = &mut self.faults {
            faults.unplug();
        }
        self.waiting.clear();
        for tick in 0..ticks {
            if self.stop.load(Ordering::Relaxed) {
                break;
            }
            self.step()?;
            self.lose();
            if self.pace == Pace::RealTime {
                let due = since + Duration::from_secs_f64((tick + 1) as f64 * self.rig.tick_s());
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
        }
        std::thread::sleep(UNPLUGGED.saturating_sub(since.elapsed()));
        self.lose();
        if let Some(faults) = &mut self.faults {
            faults.replug();
        }
        self.line.replug()?;
        Ok(())
    }

    fn lose(&mut self) {
        let sent = self.rig.take_output();
        if let Some(faults) = &mut self.faults {
            faults.push(&sent);
        }
    }
}

#[cfg(test)]
mod tests;
