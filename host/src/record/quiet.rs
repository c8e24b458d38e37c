//! Code of others that may panic on damaged input, run so that it neither ends the program nor
//! talks to the user.
//!
//! The default panic hook prints to standard error; a person who hands in a damaged file is to see
//! one message. The hook that is set here once keeps quiet on a thread while [`catch`] runs on it,
//! and otherwise does what the hook before did.

use std::cell::Cell;
use std::panic::{UnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

static HOOK: Once = Once::new();

/// Runs `f`; none where it panicked.
pub(super) fn catch<T>(f: impl FnOnce() -> T + UnwindSafe) -> Option<T> {
    HOOK.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |info| {
            if !QUIET.get() {
                before(info);
            }
        }));
    });
    let outer = QUIET.replace(true);
    let result = catch_unwind(f);
    QUIET.set(outer);
    result.ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_none() {
        assert_eq!(catch(|| 3), Some(3));
        assert_eq!(catch(|| [1, 2][std::hint::black_box(7)]), None);
        assert!(!QUIET.get());
    }
}
