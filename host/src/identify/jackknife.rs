//! What a jackknife over few blocks needs: its standard errors are known from as many changes as
//! there are blocks, so that an interval of 95 % is Student's and not a normal one.

use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::statistics::Z95;

/// Factor on standard errors from so many blocks, by which ± 1.96 of them hold 95 %:
/// t₀.₉₇₅(blocks − 1)/1.96; 1 where one block has no scatter.
pub fn widening(blocks: usize) -> f64 {
    StudentsT::new(0.0, 1.0, blocks.saturating_sub(1) as f64).map_or(1.0, |t| t.inverse_cdf(0.975) / Z95)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_blocks_have_students_interval() {
        for (blocks, t) in [(2, 12.706), (10, 2.262), (61, 2.000)] {
            assert!((1.96 * widening(blocks) - t).abs() < 2e-3, "{blocks}");
        }
        assert_eq!(widening(1), 1.0);
    }
}
