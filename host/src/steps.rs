//! Steps of long work, told to whoever listens on this thread.
//!
//! Work far below a command says what it turns to ([`tell`]); the command listens ([`heard`]) and
//! shows it. Nobody needs to listen: then it is said to nobody.

use std::cell::RefCell;
use std::sync::Arc;

/// What is done with the name of a step.
pub type Listener = Arc<dyn Fn(&str) + Send + Sync>;

thread_local! {
    static LISTENER: RefCell<Option<Listener>> = const { RefCell::new(None) };
}

/// Says which step begins, in a few words without a full stop.
pub fn tell(what: impl AsRef<str>) {
    // The listener may tell something itself.
    let listener = LISTENER.with(|l| l.borrow().clone());
    if let Some(listener) = listener {
        listener(what.as_ref());
    }
}

/// Puts back who listened before, however the work ends.
struct Before(Option<Listener>);

impl Drop for Before {
    fn drop(&mut self) {
        let before = self.0.take();
        LISTENER.with(|l| *l.borrow_mut() = before);
    }
}

/// Does work whose steps on this thread go to a listener.
pub fn heard<T>(listener: Listener, work: impl FnOnce() -> T) -> T {
    let _before = Before(LISTENER.with(|l| l.borrow_mut().replace(listener)));
    work()
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use super::*;

    #[test]
    fn steps_go_to_the_innermost_listener_and_to_nobody_without_one() {
        let told = Arc::new(Mutex::new(Vec::new()));
        let listener = |name: &'static str| -> Listener {
            let told = Arc::clone(&told);
            Arc::new(move |what: &str| told.lock().unwrap().push(format!("{name} {what}")))
        };
        tell("lost");
        heard(listener("outer"), || {
            tell("1");
            heard(listener("inner"), || tell("2"));
            // Other threads have their own.
            std::thread::scope(|s| s.spawn(|| tell("lost")).join().unwrap());
            tell(format!("{}", 3));
        });
        tell("lost");
        assert_eq!(*told.lock().unwrap(), ["outer 1", "inner 2", "outer 3"]);
    }
}
