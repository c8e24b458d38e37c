//! `whirl capture --live`: what is captured, in the terminal, while it is captured.
//!
//! The view has a thread of its own, which takes a bounded copy ([`Feed`]) ten times a second,
//! draws it and hears keys. The recording never waits for it: not for the copy, not for a terminal
//! that takes nothing more; where the terminal is gone the view ends and the recording goes on.

mod draw;
mod first_light;
mod light_page;
mod motion_page;
mod panels;
mod scene;

use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use self::scene::{Page, Scene};
use crate::capture::feed::Feed;
use crate::error::{BadInput, Result};
use crate::rig::Rig;

/// Time between two pictures.
const BETWEEN: Duration = Duration::from_millis(100);
/// How long the view may take to give the terminal back; one that takes nothing more is left alone
/// then.
const FAREWELL: Duration = Duration::from_secs(2);

/// A view that runs.
pub struct View {
    over: Arc<AtomicBool>,
    /// Lines that were shown, once the terminal is given back.
    done: Receiver<Vec<String>>,
}

impl View {
    /// Checks that there is a terminal to draw on.
    ///
    /// # Errors
    /// Standard output is none, or one that cannot place characters.
    pub fn possible() -> Result<()> {
        let remedy = "Run it in a terminal (over ssh: `ssh -t`), or leave --live out: a line on standard error tells the progress";
        if !std::io::stdout().is_terminal() {
            return Err(BadInput::new("standard output that is no terminal", "a terminal to draw on")
                .at("--live")
                .remedy(remedy));
        }
        if std::env::var_os("TERM").is_some_and(|term| term == "dumb") {
            return Err(BadInput::new("TERM=dumb", "a terminal that can place characters").at("--live").remedy(remedy));
        }
        Ok(())
    }

    /// Takes the terminal and draws what `feed` brings; `stop` is set where the end is asked for.
    ///
    /// # Errors
    /// As [`View::possible`]; a terminal that does not obey.
    pub fn begin(rig: &Rig, title: &str, feed: Arc<Feed>, stop: Arc<AtomicBool>) -> Result<Self> {
        Self::possible()?;
        let terminal = ratatui::try_init().map_err(|e| {
            ratatui::restore();
            BadInput::new(e.to_string(), "a terminal to draw on").at("--live").remedy("Leave --live out")
        })?;
        let over = Arc::new(AtomicBool::new(false));
        let (sender, done) = channel();
        let looker = Looker { terminal, scene: Scene::new(rig, title), feed, stop, over: over.clone() };
        std::thread::spawn(move || looker.look(&sender));
        Ok(Self { over, done })
    }

    /// Gives the terminal back; what was told meanwhile.
    pub fn end(self) -> Vec<String> {
        self.over.store(true, Ordering::Relaxed);
        self.done.recv_timeout(FAREWELL).unwrap_or_default()
    }
}

/// The view's thread.
struct Looker {
    terminal: DefaultTerminal,
    scene: Scene,
    feed: Arc<Feed>,
    stop: Arc<AtomicBool>,
    over: Arc<AtomicBool>,
}

impl Looker {
    /// Draws and hears until it is over, or the terminal is gone.
    fn look(mut self, done: &Sender<Vec<String>>) {
        let mut drawn: Option<Instant> = None;
        while !self.over.load(Ordering::Relaxed) {
            if drawn.is_none_or(|at| at.elapsed() >= BETWEEN) {
                drawn = Some(Instant::now());
                self.scene.take(self.feed.take());
                self.scene.ending = self.stop.load(Ordering::Relaxed);
                let scene = &self.scene;
                if self.terminal.draw(|frame| draw::draw(frame, scene)).is_err() {
                    break;
                }
            }
            self.hear(BETWEEN / 4);
        }
        self.scene.take(self.feed.take());
        ratatui::restore();
        // Nobody may listen any more.
        let _ = done.send(self.scene.lines.into());
    }

    /// Waits for keys, not longer than until the next picture.
    fn hear(&mut self, time: Duration) {
        match event::poll(time) {
            Ok(false) => {}
            Ok(true) => match event::read() {
                Ok(Event::Key(key)) if key.kind != KeyEventKind::Release => self.key(key),
                Ok(_) => {}
                Err(_) => std::thread::sleep(time),
            },
            // No keys to be had: the picture goes on.
            Err(_) => std::thread::sleep(time),
        }
    }

    fn key(&mut self, key: KeyEvent) {
        let scene = &mut self.scene;
        match key.code {
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => self.end_or_leave(),
            KeyCode::Char('q') => self.stop.store(true, Ordering::Relaxed),
            KeyCode::Tab | KeyCode::BackTab => {
                scene.page = if scene.page == Page::Motion { Page::FirstLight } else { Page::Motion };
            }
            KeyCode::Char('1') => scene.page = Page::Motion,
            KeyCode::Char('2') => scene.page = Page::FirstLight,
            KeyCode::Char('a') => scene.arm = (scene.arm + 1) % scene.arms.len().max(1),
            KeyCode::Char('r') => scene.arms.iter_mut().for_each(|arm| arm.turning.set_mark()),
            KeyCode::Char('+' | '=') => scene.zoom(true),
            KeyCode::Char('-') => scene.zoom(false),
            KeyCode::Char('f') if scene.standing.as_ref().is_some_and(|s| s.simulated) => {
                scene.hurry = self.feed.change_pace();
            }
            _ => {}
        }
    }

    /// Ctrl-C, which the terminal does not make a signal now: the first ends in order, the second
    /// at once; the journal stays.
    fn end_or_leave(&self) {
        if self.stop.swap(true, Ordering::Relaxed) {
            ratatui::restore();
            std::process::exit(130);
        }
    }
}

#[cfg(test)]
#[path = "tests.rs"]
mod tests;
