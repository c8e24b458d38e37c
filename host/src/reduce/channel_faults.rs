//! Channels that would give a wrong mode: dead ones (constant), and copies of one another.
//!
//! A copy counts twice in the energy and lowers the rank. Two channels are copies where they are
//! equal bit by bit, or agree up to a factor and an offset to 1e-9 of their size.

use nalgebra::DMatrix;
use serde::Serialize;

use super::gram::gram;

/// What is wrong with a channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "fault")]
pub enum ChannelFault {
    /// Never changes.
    Dead {
        /// Its index.
        channel: usize,
        /// The value it shows.
        value: f64,
    },
    /// Equals another one.
    Copy {
        /// Its index.
        channel: usize,
        /// Index of the channel that it repeats, the lower one.
        of: usize,
        /// Equal bit by bit; otherwise up to a factor and an offset.
        identical: bool,
    },
}

/// Relative residual (squares) of a linear relation up to which two channels are copies.
const COPY: f64 = 1e-15;
/// The same at which a block's covariance makes two channels candidates: its own rounding is far
/// below.
const CANDIDATE: f64 = 1e-9;
/// Samples taken at once by [`find`].
const BLOCK: usize = 1 << 14;

/// Dead channels and copies, in the order of the channels. Each channel is named once.
pub fn find(channels: &[&[f64]]) -> Vec<ChannelFault> {
    let mut watch = Watch::new(channels.len());
    let length = channels.iter().map(|c| c.len()).min().unwrap_or(0);
    for from in (0..length).step_by(BLOCK) {
        let block: Vec<&[f64]> = channels.iter().map(|c| &c[from..length.min(from + BLOCK)]).collect();
        watch.add(&block);
    }
    watch.finish()
}

/// Two channels that may be copies.
#[derive(Clone, Debug)]
struct Pair {
    channel: usize,
    of: usize,
    identical: bool,
    /// channel = offset + factor · of, from the block in which both began to move.
    factor: f64,
    offset: f64,
    /// Squares left by that.
    left: f64,
}

/// Looks for faults in a record that comes in blocks.
///
/// Two channels can be copies only where both begin to move in the same block; of those, the ones
/// that agree in that block are followed.
#[derive(Clone, Debug)]
pub struct Watch {
    first: Vec<f64>,
    moves: Vec<bool>,
    pairs: Vec<Pair>,
    sums: Vec<Moments>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    count: f64,
    mean: f64,
    square: f64,
}

impl Watch {
    /// Nothing seen of n channels.
    pub fn new(n: usize) -> Self {
        Self { first: Vec::new(), moves: vec![false; n], pairs: Vec::new(), sums: vec![Moments::default(); n] }
    }

    /// The next block: one slice for each channel, all of one length.
    pub fn add(&mut self, channels: &[&[f64]]) {
        let m = channels.iter().map(|c| c.len()).min().unwrap_or(0);
        if m == 0 || channels.len() != self.moves.len() {
            return;
        }
        if self.first.is_empty() {
            self.first = channels.iter().map(|c| c[0]).collect();
        }
        for pair in &mut self.pairs {
            pair.follow(channels[pair.channel], channels[pair.of], m);
        }
        let begins: Vec<usize> = (0..channels.len())
            .filter(|&k| !self.moves[k] && channels[k][..m].iter().any(|v| v.to_bits() != self.first[k].to_bits()))
            .collect();
        self.candidates(&begins, channels, m);
        for k in begins {
            self.moves[k] = true;
        }
        for (moments, c) in self.sums.iter_mut().zip(channels) {
            let mean = c[..m].iter().sum::<f64>() / m as f64;
            let square: f64 = c[..m].iter().map(|v| (v - mean) * (v - mean)).sum();
            let (a, b, delta) = (moments.count, m as f64, mean - moments.mean);
            moments.square += square + delta * delta * a * b / (a + b);
            moments.mean += delta * b / (a + b);
            moments.count += b;
        }
    }

    /// Pairs among the channels that begin to move in this block.
    fn candidates(&mut self, begins: &[usize], channels: &[&[f64]], m: usize) {
        if begins.len() < 2 {
            return;
        }
        let mut x = DMatrix::zeros(m, begins.len());
        let mut means = Vec::with_capacity(begins.len());
        for (column, k) in begins.iter().enumerate() {
            let mean = channels[*k][..m].iter().sum::<f64>() / m as f64;
            x.column_mut(column).iter_mut().zip(channels[*k]).for_each(|(to, from)| *to = from - mean);
            means.push(mean);
        }
        let g = gram(&x);
        for i in 1..begins.len() {
            for j in 0..i {
                let alike = g[(i, j)] * g[(i, j)] / (g[(i, i)] * g[(j, j)]);
                if 1.0 - alike >= CANDIDATE || !alike.is_finite() {
                    continue;
                }
                let (channel, of) = (begins[i], begins[j]);
                let factor = g[(i, j)] / g[(j, j)];
                let offset = means[i] - factor * means[j];
                // Until now both stood still: equal there if their first values are.
                let identical = self.first[channel].to_bits() == self.first[of].to_bits();
                let mut pair = Pair { channel, of, identical, factor, offset, left: 0.0 };
                pair.follow(channels[channel], channels[of], m);
                self.pairs.push(pair);
            }
        }
    }

    /// Dead channels and copies, in the order of the channels. Each channel is named once.
    pub fn finish(&self) -> Vec<ChannelFault> {
        let mut faults = Vec::new();
        for (k, moves) in self.moves.iter().enumerate() {
            if !moves {
                faults.extend(self.first.get(k).map(|v| ChannelFault::Dead { channel: k, value: *v }));
                continue;
            }
            // A copy still stands for the channels that repeat it in turn, but is named by the
            // first of them.
            let copies = self.pairs.iter().filter(|p| p.channel == k);
            let copy = copies.filter(|p| p.identical || p.left < COPY * self.sums[k].square).min_by_key(|p| p.of);
            faults.extend(copy.map(|p| ChannelFault::Copy { channel: k, of: p.of, identical: p.identical }));
        }
        faults
    }
}

impl Pair {
    fn follow(&mut self, channel: &[f64], of: &[f64], m: usize) {
        for (y, x) in channel[..m].iter().zip(&of[..m]) {
            let left = y - self.offset - self.factor * x;
            self.left += left * left;
            self.identical &= y.to_bits() == x.to_bits();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_that_begins_late_or_ends_early_is_judged_over_the_whole_record() {
        let m = 3 * BLOCK;
        let swing = |i: usize| (i as f64 * 0.1).sin();
        let late: Vec<f64> = (0..m).map(|i| if i < BLOCK + 7 { 0.5 } else { swing(i) }).collect();
        let twice: Vec<f64> = late.iter().map(|x| 2.0 * x).collect();
        let mut parts_at_the_end = late.clone();
        parts_at_the_end[m - 1] += 0.1;
        let early: Vec<f64> = (0..m).map(swing).collect();
        assert_eq!(
            find(&[&early, &late, &parts_at_the_end, &twice]),
            [ChannelFault::Copy { channel: 3, of: 1, identical: false }]
        );
    }

    #[test]
    fn dead_channels_and_copies_are_named() {
        let a: Vec<f64> = (0..500).map(|i| (f64::from(i) * 0.1).sin()).collect();
        let near: Vec<f64> = a.iter().enumerate().map(|(i, x)| x + 1e-6 * (i as f64 * 0.7).cos()).collect();
        let scaled: Vec<f64> = a.iter().map(|x| 3.0 - 2.0 * x).collect();
        let dead = vec![0.25; 500];
        let found = find(&[&a, &dead, &near, &a, &scaled]);
        assert_eq!(
            found,
            [
                ChannelFault::Dead { channel: 1, value: 0.25 },
                ChannelFault::Copy { channel: 3, of: 0, identical: true },
                ChannelFault::Copy { channel: 4, of: 0, identical: false },
            ]
        );
    }
}
