//! What joins the two halves: one end puts, the other takes, neither waits.
//!
//! The traits let the same code run on the two ends of a split `heapless::spsc::Queue` (a board:
//! interrupt and thread) and on a whole one (an [`crate::app::App`]).

use heapless::spsc::{Consumer, Producer, Queue};

/// The end that puts.
pub trait Sink<T> {
    /// Puts an item.
    ///
    /// # Errors
    /// The item, where the queue is full.
    fn put(&mut self, item: T) -> Result<(), T>;
}

/// The end that takes.
pub trait Source<T> {
    /// The oldest item, if any.
    fn take(&mut self) -> Option<T>;
}

impl<T, const N: usize> Sink<T> for Queue<T, N> {
    fn put(&mut self, item: T) -> Result<(), T> {
        self.enqueue(item)
    }
}

impl<T, const N: usize> Source<T> for Queue<T, N> {
    fn take(&mut self) -> Option<T> {
        self.dequeue()
    }
}

impl<T> Sink<T> for Producer<'_, T> {
    fn put(&mut self, item: T) -> Result<(), T> {
        self.enqueue(item)
    }
}

impl<T> Source<T> for Consumer<'_, T> {
    fn take(&mut self) -> Option<T> {
        self.dequeue()
    }
}
