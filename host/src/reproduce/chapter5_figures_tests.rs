//! Every figure has its series and numbers.

use super::*;

#[test]
fn every_figure_has_its_series_and_numbers() {
    for item in ITEMS {
        let r = (item.run)().unwrap();
        assert_eq!(r.id, item.id);
        assert!(
            !r.panels.0.is_empty() && r.panels.0.iter().all(|p| p.series.iter().all(|s| s.x.len() > 10)),
            "{}",
            item.id
        );
        assert!(r.rows.iter().all(|row| row.reproduced.is_some_and(f64::is_finite)), "{:?}", r.rows);
    }
}
