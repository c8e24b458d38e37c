//! Fewer points that look the same.

/// Indices of at most about `most` samples that keep the least and the greatest of each of most/2
/// equal stretches, in order; first and last are kept. Peaks survive. Values that are not finite
/// are left out.
pub fn extremes(y: &[f64], most: usize) -> Vec<usize> {
    let n = y.len();
    if n <= most.max(4) {
        return (0..n).collect();
    }
    let buckets = (most / 2).max(2);
    let mut kept = Vec::with_capacity(2 * buckets + 2);
    for b in 0..buckets {
        let (from, to) = (b * n / buckets, (b + 1) * n / buckets);
        let finite = || (from..to).filter(|&i| y[i].is_finite());
        let (Some(low), Some(high)) =
            (finite().min_by(|&i, &j| y[i].total_cmp(&y[j])), finite().max_by(|&i, &j| y[i].total_cmp(&y[j])))
        else {
            continue;
        };
        kept.extend([low.min(high), low.max(high)]);
    }
    kept.extend([0, n - 1].into_iter().filter(|&i| y[i].is_finite()));
    kept.sort_unstable();
    kept.dedup();
    kept
}

/// Every k-th index, at most `most` of them.
pub fn stride(n: usize, most: usize) -> impl Iterator<Item = usize> {
    (0..n).step_by(n.div_ceil(most.max(1)).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_peak_survives() {
        let mut y = vec![0.0; 100_000];
        y[54_321] = 1.0;
        y[54_400] = -2.0;
        let kept = extremes(&y, 2000);
        assert!(kept.len() <= 2002 && kept.contains(&54_321) && kept.contains(&54_400));
        assert!(kept.windows(2).all(|w| w[0] < w[1]));
        assert_eq!((kept[0], kept[kept.len() - 1]), (0, 99_999));
        assert_eq!(extremes(&[1.0, 2.0], 2000), [0, 1]);
        assert_eq!(stride(10_001, 2000).count(), 1667);
    }
}
