//! Channels that would give a wrong mode: dead ones (constant), and copies of one another.
//!
//! A copy counts twice in the energy and lowers the rank. Two channels are copies where they are equal bit by bit, or agree up to a
//! factor and an offset to 1e-9 of their size.

use serde::Serialize;

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

/// Dead channels and copies, in the order of the channels. Each channel is named once.
pub fn find(channels: &[&[f64]]) -> Vec<ChannelFault> {
    let mut faults = Vec::new();
    let mut sums: Vec<Option<(f64, f64)>> = Vec::with_capacity(channels.len());
    for (k, x) in channels.iter().enumerate() {
        let first = x.first().copied().unwrap_or(0.0);
        if x.iter().all(|v| v.to_bits() == first.to_bits()) {
            faults.push(ChannelFault::Dead { channel: k, value: first });
            sums.push(None);
            continue;
        }
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let square: f64 = x.iter().map(|v| (v - mean) * (v - mean)).sum();
        for (j, y) in channels[..k].iter().enumerate() {
            let Some((mean_j, square_j)) = sums[j] else { continue };
            let identical = x.len() == y.len() && x.iter().zip(*y).all(|(a, b)| a.to_bits() == b.to_bits());
            let cross: f64 = x.iter().zip(*y).map(|(a, b)| (a - mean) * (b - mean_j)).sum();
            if identical || 1.0 - cross * cross / (square * square_j) < 1e-15 {
                faults.push(ChannelFault::Copy { channel: k, of: j, identical });
                break;
            }
        }
        // A copy still stands for the channels that repeat it in turn, but is named by the first of them.
        sums.push(Some((mean, square)));
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

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
