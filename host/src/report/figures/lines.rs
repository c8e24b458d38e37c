//! Lines: time histories, spectra.

use super::Figure;
use super::canvas::{Layout, Panel, Series, Shape};
use super::decimate;

/// Most points of one series.
pub const MOST: usize = 2000;

/// Thins a series to [`MOST`] points: least and greatest of each stretch are kept. A gap (values
/// that are not finite) stays.
pub fn thinned(series: &Series) -> Series {
    if series.x.len() <= MOST {
        return series.clone();
    }
    let mut out = Series { x: Vec::new(), y: Vec::new(), ..series.clone() };
    let mut start = 0;
    for (n, part) in series.y.split(|y| !y.is_finite()).enumerate() {
        if n > 0 {
            out.x.push(f64::NAN);
            out.y.push(f64::NAN);
        }
        let share = (MOST * part.len() / series.y.len()).max(4);
        for i in decimate::extremes(part, share) {
            out.x.push(series.x[start + i]);
            out.y.push(part[i]);
        }
        start += part.len() + 1;
    }
    out
}

/// Draws panels of lines one below the other; long series are thinned. Panels that set `shares_x`
/// leave the horizontal axis to the one below.
pub fn lines(caption: &str, height: f64, panels: &[Panel]) -> Figure {
    let thin: Vec<Panel> = panels
        .iter()
        .map(|p| Panel {
            series: p
                .series
                .iter()
                .map(|s| if matches!(s.shape, Shape::Line | Shape::Thin) { thinned(s) } else { s.clone() })
                .collect(),
            ..p.clone()
        })
        .collect();
    Figure::draw(caption, &Layout { height, ..Layout::default() }, &thin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_peaks_and_gaps() {
        let x: Vec<f64> = (0..50_000).map(f64::from).collect();
        let mut y = vec![0.0; 50_000];
        y[777] = 9.0;
        y[30_000] = f64::NAN;
        y[49_000] = -9.0;
        let thin = thinned(&Series::new("", Shape::Line, x, y));
        assert!(thin.x.len() <= MOST + 8);
        let at = |v: f64| thin.y.iter().position(|y| *y == v).map(|i| thin.x[i]);
        assert_eq!((at(9.0), at(-9.0)), (Some(777.0), Some(49_000.0)));
        assert_eq!(thin.y.iter().filter(|y| y.is_nan()).count(), 1);
    }
}
