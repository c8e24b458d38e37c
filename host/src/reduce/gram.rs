//! XᵀX for tall X, by blocks of columns in parallel, the lower triangle only and mirrored.
//!
//! Blocks are fixed, so that the number of threads never changes a digit.

use nalgebra::DMatrix;
use rayon::prelude::*;

/// Columns in a block.
const COLUMNS: usize = 128;

/// XᵀX (n × n) of X (m × n).
pub fn gram(x: &DMatrix<f64>) -> DMatrix<f64> {
    let n = x.ncols();
    let starts: Vec<usize> = (0..n).step_by(COLUMNS).collect();
    let pairs: Vec<(usize, usize)> =
        starts.iter().flat_map(|&i| starts.iter().filter(move |&&j| j <= i).map(move |&j| (i, j))).collect();
    // A product of matrices is blocked and vectorised where one of transposes is a row of scalar products: transpose once.
    let turned = x.transpose();
    let blocks: Vec<DMatrix<f64>> =
        pairs.par_iter().map(|&(i, j)| turned.rows(i, COLUMNS.min(n - i)) * x.columns(j, COLUMNS.min(n - j))).collect();
    let mut out = DMatrix::zeros(n, n);
    for (&(i, j), block) in pairs.iter().zip(&blocks) {
        out.view_mut((i, j), block.shape()).copy_from(block);
        if i != j {
            out.view_mut((j, i), (block.ncols(), block.nrows())).copy_from(&block.transpose());
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_make_the_whole_product() {
        let x = DMatrix::from_fn(90, 300, |i, j| ((i * 31 + j * 17) % 23) as f64 - 11.0);
        assert!((gram(&x) - x.tr_mul(&x)).amax() < 1e-9);
    }
}
