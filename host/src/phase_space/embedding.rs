//! Delay vectors S(k) = (s(k), s(k + T_d), …, s(k + (d − 1) T_d)), of one observable or of several
//! side by side.
//!
//! A component is an observable and a delay in samples; a vector belongs to time k where every
//! component's sample lies in the same unbroken stretch. Vectors are not stored: [`Embedding::at`]
//! reads the observable, and `starts` lists the times k, all of them or every s-th.

use super::observable::{Observable, distance};

/// One component of a delay vector.
#[derive(Clone, Copy, Debug)]
pub struct Component<'a> {
    /// Of what.
    pub of: &'a Observable,
    /// Samples later than k.
    pub delay: usize,
}

/// A set of delay vectors.
#[derive(Clone, Debug)]
pub struct Embedding<'a> {
    /// Components, in order; a prefix of them is an embedding of lower dimension.
    pub components: Vec<Component<'a>>,
    /// Times k of the vectors, increasing.
    pub starts: Vec<u32>,
}

impl<'a> Embedding<'a> {
    /// `dimension` components of one observable at multiples of `delay`. `ahead`: samples that must
    /// follow a vector's last component within its stretch. At most `most` vectors, evenly spread
    /// (every s-th).
    pub fn of_one(of: &'a Observable, delay: usize, dimension: usize, ahead: usize, most: usize) -> Self {
        let components = (0..dimension).map(|j| Component { of, delay: j * delay }).collect();
        Self::new(components, ahead, most)
    }

    /// Vectors of given components; all observables share their stretches.
    pub fn new(components: Vec<Component<'a>>, ahead: usize, most: usize) -> Self {
        let reach = components.iter().map(|c| c.delay).max().unwrap_or(0).saturating_add(ahead);
        let mut starts = Vec::new();
        if let Some(first) = components.first() {
            let whole: usize = first.of.stretches.iter().map(|r| r.len().saturating_sub(reach)).sum();
            let stride = whole.div_ceil(most.max(1)).max(1);
            for r in &first.of.stretches {
                let last = r.end.saturating_sub(reach);
                starts.extend((r.start..last.max(r.start)).step_by(stride).map(|k| k as u32));
            }
        }
        Self { components, starts }
    }

    /// Number of vectors.
    pub fn len(&self) -> usize {
        self.starts.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.starts.is_empty()
    }

    /// Component j of the vector that starts at sample `start`.
    #[inline(always)]
    pub fn at(&self, start: u32, j: usize) -> f32 {
        let c = &self.components[j];
        c.of.values[start as usize + c.delay]
    }

    /// Square of the Euclidean distance of two vectors in the first `dimension` components.
    #[inline]
    pub fn distance2(&self, a: u32, b: u32, dimension: usize) -> f32 {
        let mut sum = 0.0;
        for j in 0..dimension {
            let d = distance(self.at(a, j), self.at(b, j), self.components[j].of.period);
            sum += d * d;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_do_not_straddle_gaps() {
        let o = Observable::number(&[&[0.0, 1.0, 2.0, 3.0, 4.0], &[5.0, 6.0], &[7.0, 8.0, 9.0, 10.0]], 0.0, 0);
        let e = Embedding::of_one(&o, 1, 3, 0, 100);
        assert_eq!(e.starts, [0, 1, 2, 7, 8]);
        assert_eq!((0..3).map(|j| e.at(7, j)).collect::<Vec<_>>(), [0.7, 0.8, 0.9]);
        assert_eq!(Embedding::of_one(&o, 1, 3, 1, 100).starts, [0, 1, 7]);
        assert_eq!(Embedding::of_one(&o, 1, 3, 0, 3).starts, [0, 2, 7]);
        assert!(Embedding::of_one(&o, 9, 3, 0, 3).is_empty() && Embedding::new(vec![], 0, 1).is_empty());
        assert!((e.distance2(0, 7, 2) - 0.98).abs() < 1e-6);
    }
}
