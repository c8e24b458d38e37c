//! Colours that people with any colour vision tell apart (Okabe and Ito 2008), in the order in
//! which series take them.

use plotters::style::RGBColor;

/// Blue, vermilion, bluish green, reddish purple, orange, sky blue; yellow is left out: too pale on
/// white.
pub const SERIES: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// Text and frames.
pub const INK: RGBColor = RGBColor(26, 29, 33);
/// Secondary text and reference lines.
pub const SOFT: RGBColor = RGBColor(110, 119, 130);
/// Grid.
pub const GRID: RGBColor = RGBColor(230, 233, 237);

/// Index of what was measured, in the colour of text.
pub const MEASURED: usize = usize::MAX;

/// Colour of series i; they repeat after six.
pub fn series(i: usize) -> RGBColor {
    if i == MEASURED { INK } else { SERIES[i % SERIES.len()] }
}
