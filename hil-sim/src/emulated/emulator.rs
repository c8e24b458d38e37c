//! Starts QEMU with an image, is the plant at the other end of its pipes, and ends with it.
//!
//! Needs `qemu-system-arm` (7.2 or newer) and a Unix system. Instructions are counted
//! (`-icount shift=5`: 32 ns each), so that the board's time depends on nothing but its program.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{CWD, FileType, Mode, OFlags};
use whirl_firmware::lock_step::{
    FROM_PLANT, Order, REQUEST_LEN, Reply, Request, SHAPE_LEN, TO_PLANT, shape_from_bytes,
};

use super::plant::EmulatedPlant;
use super::script::Script;
use crate::error::SimulationError;
use crate::shaker::CommandShape;
use crate::virtual_rig::RigSettings;

/// Where the board's UART0 goes.
#[derive(Clone, Debug)]
pub enum Serial {
    /// Into [`Emulation::frames`]; nothing comes from there.
    Kept,
    /// A TCP port of this machine, on which the emulator listens; it starts when somebody has
    /// connected.
    Tcp(u16),
}

/// What is emulated.
#[derive(Clone, Debug)]
pub struct EmulatorSettings {
    /// The image, ELF.
    pub image: PathBuf,
    /// The emulator: `qemu-system-arm`, or where it is.
    pub qemu: PathBuf,
    /// A folder for pipes and output, which must be there; files of earlier runs in it are
    /// replaced.
    pub folder: PathBuf,
    /// The rig.
    pub rig: RigSettings,
    /// Where UART0 goes.
    pub serial: Serial,
    /// Ticks to run; none: until `stop`.
    pub ticks: Option<u32>,
    /// What the host says and the test orders.
    pub script: Script,
    /// Set from elsewhere to end the run in order.
    pub stop: Arc<AtomicBool>,
    /// Longest time that the emulator may let the plant wait, of the wall's clock.
    pub patience: Duration,
}

impl EmulatorSettings {
    /// The default rig, a silent host, output kept, a minute's patience.
    pub fn new(image: impl Into<PathBuf>, folder: impl Into<PathBuf>, ticks: u32) -> Self {
        Self {
            image: image.into(),
            qemu: PathBuf::from("qemu-system-arm"),
            folder: folder.into(),
            rig: RigSettings::default(),
            serial: Serial::Kept,
            ticks: Some(ticks),
            script: Script::new(),
            stop: Arc::default(),
            patience: Duration::from_secs(60),
        }
    }
}

/// What the image says of its own run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Account {
    /// Ticks, missed ones too.
    pub ticks: u32,
    /// Clocks of a tick; most by which one came early, and late.
    pub period: [u32; 3],
    /// Longest time from tick to interrupt, clocks.
    pub latency: u32,
    /// Deepest stack, bytes.
    pub stack: u32,
    /// Statics, bytes.
    pub statics: u32,
}

/// How an emulation went.
#[derive(Clone, Debug)]
pub struct Emulation {
    /// What UART0 sent, if it was kept.
    pub frames: Vec<u8>,
    /// The emulator's exit status: 0 where the image ended in order.
    pub status: Option<i32>,
    /// The image's account, where it ended in order.
    pub account: Option<Account>,
    /// What the image wrote to the console.
    pub console: String,
    /// The last request; after a panic the board's last words.
    pub last: Request,
    /// What stood at the shaker's output at each request, nm.
    pub set_points: Vec<i32>,
    /// How often the board began anew.
    pub resets: u32,
}

impl Emulation {
    /// Requests at which the shaker's output stood anywhere but at rest.
    pub fn moving_ticks(&self) -> usize {
        self.set_points.iter().filter(|&&y| y != 0).count()
    }
}

/// Why there was no emulation, or why it ended.
#[derive(Debug, thiserror::Error)]
pub enum EmulatorError {
    /// The plant failed.
    #[error(transparent)]
    Plant(#[from] SimulationError),
    /// The emulator could not be started.
    #[error("{qemu} could not be started: {error}; install it with `apt-get install qemu-system-arm`")]
    Start {
        /// The emulator.
        qemu: String,
        /// Why.
        error: io::Error,
    },
    /// Files and pipes.
    #[error("the emulated board's {what} failed: {error}")]
    File {
        /// What.
        what: &'static str,
        /// Why.
        error: io::Error,
    },
    /// The emulator stopped asking.
    #[error("the emulated board has sent nothing for {seconds} s; its console: {console}")]
    Silent {
        /// For so long.
        seconds: u64,
        /// The console.
        console: String,
    },
}

fn file(what: &'static str) -> impl Fn(io::Error) -> EmulatorError {
    move |error| EmulatorError::File { what, error }
}

/// The emulator's process, which does not outlive its owner.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A pipe in the file system, open at both ends so that opening does not wait for the emulator.
fn pipe(path: &Path) -> io::Result<File> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(e),
        _ => {}
    }
    rustix::fs::mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0)?;
    Ok(File::from(rustix::fs::open(path, OFlags::RDWR | OFlags::CLOEXEC, Mode::empty())?))
}

/// Runs an image until its ticks are done, it is told to stop, or it ends by itself.
///
/// # Errors
/// No emulator, no image, no folder; a plant that fails; an emulator that hangs.
pub fn run(settings: &EmulatorSettings) -> Result<Emulation, EmulatorError> {
    let mut plant = EmulatedPlant::new(&settings.rig)?;
    let folder = &settings.folder;
    let mut to_plant = pipe(&folder.join(TO_PLANT)).map_err(file("pipe"))?;
    let mut from_plant = pipe(&folder.join(FROM_PLANT)).map_err(file("pipe"))?;
    let console_path = folder.join("console.txt");
    let console = File::create(&console_path).map_err(file("console"))?;
    let output = folder.join("uart0.frames");
    let mut process = Process(start(settings, console, &output)?);

    let mut emulation = Emulation {
        frames: Vec::new(),
        status: None,
        account: None,
        console: String::new(),
        last: Request::default(),
        set_points: Vec::new(),
        resets: 0,
    };
    // Ticks of all boots before the present one.
    let (mut before, mut newest) = (0_u32, None);
    let mut bytes = [0; REQUEST_LEN];
    while filled(&mut bytes, &mut to_plant, &mut process.0, settings, &console_path)? {
        let mut request = Request::from_bytes(&bytes);
        if newest.is_some_and(|newest| request.tick < newest) {
            before += newest.unwrap_or(0) + 1;
            emulation.resets += 1;
            plant.reset();
        }
        newest = Some(request.tick);
        // To plant and script the ticks run on.
        request.tick = request.tick.saturating_add(before);
        emulation.last = request;
        if request.panicked {
            break;
        }
        emulation.set_points.push(request.displacement_nanometre);
        if request.shape_follows {
            let mut shape = [0; SHAPE_LEN];
            if !filled(&mut shape, &mut to_plant, &mut process.0, settings, &console_path)? {
                break;
            }
            let shape = shape_from_bytes(&shape, CommandShape::of).ok_or_else(|| SimulationError::Board {
                tick: request.tick,
                problem: "it tells of a table of points that no table has".to_owned(),
            })?;
            plant.reshape(shape);
        }
        let (counts, base) = plant.exchange(&request)?;
        let end = settings.ticks.is_some_and(|n| request.tick.saturating_add(1) >= n);
        let order = match settings.script.order_at(request.tick) {
            _ if end || settings.stop.load(Ordering::Relaxed) => Order::Exit,
            order => order,
        };
        let host = settings.script.bytes_at(request.tick);
        // A script holds no more at one tick.
        let reply = Reply { counts, base, order, host_bytes: host.len() as u8 };
        let mut message = Vec::with_capacity(host.len() + 8);
        message.extend(reply.to_bytes());
        message.extend(host);
        from_plant.write_all(&message).map_err(file("pipe"))?;
    }
    emulation.status = process.0.wait().map_err(file("end"))?.code();
    emulation.console = fs::read_to_string(&console_path).map_err(file("console"))?;
    emulation.account = account(&emulation.console);
    if matches!(settings.serial, Serial::Kept) {
        emulation.frames = fs::read(&output).map_err(file("output"))?;
    }
    Ok(emulation)
}

fn start(settings: &EmulatorSettings, console: File, output: &Path) -> Result<Child, EmulatorError> {
    let image = fs::canonicalize(&settings.image).map_err(file("image"))?;
    let serial = match settings.serial {
        Serial::Kept => format!(
            "file:{}",
            fs::canonicalize(&settings.folder)
                .map_err(file("folder"))?
                .join(output.file_name().unwrap_or_default())
                .display()
        ),
        Serial::Tcp(port) => format!("tcp:127.0.0.1:{port},server=on,wait=on,nodelay=on"),
    };
    Command::new(&settings.qemu)
        .args(["-machine", "mps2-an386", "-display", "none", "-monitor", "none", "-nodefaults"])
        .args(["-semihosting-config", "enable=on,target=native"])
        .args(["-icount", "shift=5,sleep=off"])
        .args(["-serial", &serial])
        .arg("-kernel")
        .arg(image)
        .current_dir(&settings.folder)
        .stdin(Stdio::null())
        .stdout(console.try_clone().map_err(file("console"))?)
        .stderr(console)
        .spawn()
        .map_err(|error| EmulatorError::Start { qemu: settings.qemu.display().to_string(), error })
}

/// Reads what the board says next; false where the emulator has ended.
fn filled(
    bytes: &mut [u8],
    pipe: &mut File,
    child: &mut Child,
    settings: &EmulatorSettings,
    console: &Path,
) -> Result<bool, EmulatorError> {
    let mut filled = 0;
    let since = Instant::now();
    // Long enough to cost nothing, short enough for a person who waits for the end.
    let wait = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
    while filled < bytes.len() {
        let ready = match poll(&mut [PollFd::new(pipe, PollFlags::IN)], Some(&wait)) {
            Ok(ready) => ready > 0,
            Err(rustix::io::Errno::INTR) => false,
            Err(error) => return Err(file("pipe")(error.into())),
        };
        if ready {
            filled += pipe.read(&mut bytes[filled..]).map_err(file("pipe"))?;
            continue;
        }
        if child.try_wait().map_err(file("end"))?.is_some() {
            return Ok(false);
        }
        // Before the first tick an emulator that listens waits for its client, who may never come.
        if settings.stop.load(Ordering::Relaxed) && since.elapsed() > Duration::from_secs(2) {
            child.kill().map_err(file("end"))?;
        }
        if since.elapsed() > settings.patience {
            let console = fs::read_to_string(console).unwrap_or_default();
            return Err(EmulatorError::Silent { seconds: settings.patience.as_secs(), console });
        }
    }
    Ok(true)
}

/// Reads the image's account.
fn account(console: &str) -> Option<Account> {
    let numbers = |name: &str| -> Option<Vec<u32>> {
        let line = console.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '))?;
        Some(line.split(|c: char| !c.is_ascii_digit()).filter_map(|n| n.parse().ok()).collect())
    };
    let one = |name: &str| numbers(name)?.first().copied();
    Some(Account {
        ticks: one("ticks")?,
        period: numbers("period")?.try_into().ok()?,
        latency: one("latency")?,
        stack: one("stack")?,
        statics: one("statics")?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_account_is_read_and_anything_else_is_none() {
        let text =
            "ticks 10\nperiod 50000 clocks, early 1 late 2\nlatency 12 clocks\nstack 3000 bytes\nstatics 9 bytes\n";
        let want = Account { ticks: 10, period: [50_000, 1, 2], latency: 12, stack: 3000, statics: 9 };
        assert_eq!(account(text), Some(want));
        assert_eq!(account("ticks 10\n"), None);
        assert_eq!(account(""), None);
    }

    #[test]
    fn what_is_missing_is_named() {
        let folder = std::env::temp_dir().join(format!("whirl-emulator-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let image = std::env::current_exe().unwrap();
        let settings =
            EmulatorSettings { qemu: PathBuf::from("no-such-emulator"), ..EmulatorSettings::new(&image, &folder, 1) };
        let error = run(&settings).unwrap_err().to_string();
        assert!(error.contains("no-such-emulator") && error.contains("apt-get install"), "{error}");
        let error = run(&EmulatorSettings::new("no-such-image", &folder, 1)).unwrap_err().to_string();
        assert!(error.contains("image"), "{error}");
        // An emulator that ends at once is no emulation, and no endless wait.
        let settings = EmulatorSettings { qemu: PathBuf::from("true"), ..EmulatorSettings::new(&image, &folder, 1) };
        fs::write(folder.join("uart0.frames"), []).unwrap();
        let emulation = run(&settings).unwrap();
        assert_eq!((emulation.account, emulation.frames.len()), (None, 0));
        fs::remove_dir_all(folder).unwrap();
    }
}
