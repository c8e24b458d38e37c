//! Parameters of simulated rigs beside their truth.

use whirl_tests::accuracy::{coverage, table};

/// Seeds for each drive frequency; `--example identification_table` prints what this test holds.
const SEEDS: u64 = 20;

#[test]
fn parameters_of_the_chaotic_rig_are_found_with_honest_standard_errors() {
    let table = table(&[5.0, 5.2], 1..=SEEDS);
    assert_eq!(table.len() as u64, 2 * SEEDS * 13);
    for c in &table {
        assert!(c.relative() <= c.allowed(), "off by {:.3} %: {c:?}", 100.0 * c.relative());
        assert!(c.std_error > 0.0 && c.deviations() <= 5.0, "{:.1} standard errors: {c:?}", c.deviations());
    }
    let (comparisons, within, worst) = coverage(&table);
    assert!(within as f64 >= 0.98 * comparisons as f64, "{within} of {comparisons} within 3, the farthest at {worst}");
}
