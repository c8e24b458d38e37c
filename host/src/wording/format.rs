//! Numbers for people: digits that the uncertainty warrants, SI units, powers of ten.

use crate::error::plain;
pub use crate::statistics::Z95;

/// A whole number as a superscript: `⁻⁶`.
pub fn superscript(exponent: i32) -> String {
    exponent
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            '4' => '⁴',
            '5' => '⁵',
            '6' => '⁶',
            '7' => '⁷',
            '8' => '⁸',
            '9' => '⁹',
            _ => '⁰',
        })
        .collect()
}

/// A power of ten: `10⁻⁶`.
pub fn power_of_ten(exponent: i32) -> String {
    format!("10{}", superscript(exponent))
}

/// A number with as few digits as tell it apart from others at ten digits: `0.01`, `20`, `1.5`.
pub fn shortest(x: f64) -> String {
    let rounded: f64 = format!("{x:.9e}").parse().unwrap_or(x);
    if rounded < 0.0 { format!("−{}", -rounded) } else { rounded.to_string() }
}

/// A number rounded to so many significant digits.
pub fn rounded(x: f64, digits: usize) -> f64 {
    format!("{x:.*e}", digits.saturating_sub(1)).parse().unwrap_or(x)
}

/// A number rounded up to so many significant digits: not below it, as a least value is told.
pub fn rounded_up(x: f64, digits: usize) -> f64 {
    let near = rounded(x, digits);
    if near >= x {
        return near;
    }
    let exponent: i32 = format!("{near:e}").split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    rounded(near + 10f64.powi(exponent + 1 - digits as i32), digits)
}

/// A word of a command as a shell takes it.
pub fn shell_word(text: &str) -> String {
    let bare = |c: char| c.is_alphanumeric() || "/._-:@+=,".contains(c);
    if !text.is_empty() && text.chars().all(bare) {
        text.to_owned()
    } else {
        format!("'{}'", plain(text).replace('\'', "'\\''"))
    }
}

/// A number with `decimals` digits after the point and a true minus sign; "−0.00" becomes "0.00".
pub fn fixed(x: f64, decimals: usize) -> String {
    if !x.is_finite() {
        return if x.is_nan() { "–".to_owned() } else { if x > 0.0 { "∞" } else { "−∞" }.to_owned() };
    }
    let text = format!("{:.*}", decimals, x.abs());
    let zero = text.chars().all(|c| matches!(c, '0' | '.'));
    if x < 0.0 && !zero { format!("−{text}") } else { text }
}

/// Decimal exponent of |x| after rounding to `digits` significant digits.
pub(super) fn exponent(x: f64, digits: usize) -> i32 {
    let text = format!("{:.*e}", digits.max(1) - 1, x.abs());
    text.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0)
}

/// A number with so many significant digits; below 1e-3 and from 1e6 on with a power of ten.
pub fn significant(x: f64, digits: usize) -> String {
    if x == 0.0 || !x.is_finite() {
        return fixed(x, 0);
    }
    let e = exponent(x, digits);
    let digits = digits.max(1) as i32;
    if (-3..6).contains(&e) {
        fixed(x, (digits - 1 - e).max(0) as usize)
    } else {
        format!("{}·10{}", fixed(x / 10f64.powi(e), (digits - 1) as usize), superscript(e))
    }
}

/// Decimal place (power of ten of the last digit) that an uncertainty warrants, and the uncertainty
/// rounded to it: two digits where it starts below 3.55, one from there on, two again from 9.5 (the
/// Particle Data Group's rule).
fn last_place(uncertainty: f64) -> i32 {
    let e = uncertainty.log10().floor() as i32;
    let lead = uncertainty / 10f64.powi(e);
    if lead < 3.55 { e - 1 } else { e }
}

/// `value ± uncertainty`, both to the digits that the uncertainty warrants: `0.11312 ± 0.00004`,
/// `(5.990 ± 0.003)·10⁻⁴`. Without a usable uncertainty the value has five digits.
pub fn plus_minus(value: f64, uncertainty: f64) -> String {
    if !(uncertainty.is_finite() && uncertainty > 0.0 && value.is_finite()) {
        return significant(value, 5);
    }
    let place = last_place(uncertainty);
    let top = exponent(value.abs().max(uncertainty), 2);
    if !(-3..=5).contains(&top) || place > 0 {
        let scale = 10f64.powi(top);
        let decimals = (top - place).clamp(0, 15) as usize;
        let (v, u) = (fixed(value / scale, decimals), fixed(uncertainty / scale, decimals));
        return format!("({v} ± {u})·10{}", superscript(top));
    }
    let decimals = (-place).clamp(0, 18) as usize;
    format!("{} ± {}", fixed(value, decimals), fixed(uncertainty, decimals))
}

/// A value alone to the digits that its uncertainty warrants (for a true value beside an estimate).
pub fn to_digits_of(value: f64, uncertainty: f64) -> String {
    if !(uncertainty.is_finite() && uncertainty > 0.0 && value.is_finite()) {
        return significant(value, 5);
    }
    let place = last_place(uncertainty);
    let top = if value == 0.0 { place } else { exponent(value, 2) };
    if !(-3..=5).contains(&top) || place > 0 {
        return significant(value, (top - place + 1).clamp(1, 15) as usize);
    }
    fixed(value, (-place).clamp(0, 18) as usize)
}

/// A whole number with thin spaces between groups of three: `1 800 000`.
pub fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) && digits.len() > 4 {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

/// "1 row", "2 rows", "12 000 rows".
pub fn several(n: usize, noun: &str) -> String {
    let s = if n == 1 { "" } else { "s" };
    format!("{} {noun}{s}", count(n as u64))
}

/// A length of time in s, however short, to three digits: `0.534 s`, `4.00 s`, `4.45·10⁻⁴ s`.
pub fn in_seconds(s: f64) -> String {
    format!("{} s", significant(s, 3))
}

/// A time of a record whose samples are `step_s` apart, in s: to the millisecond, or to what tells
/// its samples apart where they are closer.
pub fn instant(time_s: f64, step_s: f64) -> String {
    let decimals = if step_s > 0.0 { (-step_s.log10()).ceil().clamp(3.0, 12.0) as usize } else { 3 };
    fixed(time_s, decimals)
}

/// A length of time: `120.0 s`, `12 min 5 s`, `1 h 0 min 3 s`; below a second in ms or µs.
pub fn duration(seconds: f64) -> String {
    let s = seconds.abs();
    if !s.is_finite() {
        return fixed(seconds, 0);
    }
    if s == 0.0 {
        "0 s".to_owned()
    } else if s < 1e-3 {
        format!("{} µs", significant(seconds * 1e6, 3))
    } else if s < 1.0 {
        format!("{} ms", significant(seconds * 1e3, 3))
    } else if s < 600.0 {
        format!("{} s", significant(seconds, if s < 100.0 { 3 } else { 4 }))
    } else {
        let whole = s.round() as u64;
        let (h, m, r) = (whole / 3600, whole / 60 % 60, whole % 60);
        let hours = if h > 0 { format!("{h} h ") } else { String::new() };
        format!("{}{hours}{m} min {r} s", if seconds < 0.0 { "−" } else { "" })
    }
}

/// A value with its SI unit and a prefix that keeps it between 1 and 1000, for units that take one
/// (m, s, Hz, N, V, A, rad, N m); others are written as they are.
pub fn quantity(value: f64, unit: &str, digits: usize) -> String {
    let takes = ["m", "s", "Hz", "N", "V", "A", "rad", "N m"].contains(&unit);
    if !takes || value == 0.0 || !value.is_finite() || (0.1..1000.0).contains(&value.abs()) {
        return if unit.is_empty() || unit == "1" {
            significant(value, digits)
        } else {
            format!("{} {unit}", significant(value, digits))
        };
    }
    let e3 = (exponent(value, digits).div_euclid(3)).clamp(-4, 3);
    let prefix = ["p", "n", "µ", "m", "", "k", "M", "G"][(e3 + 4) as usize];
    format!("{} {prefix}{unit}", significant(value / 10f64.powi(3 * e3), digits))
}

/// A unit as it stands behind a number, a blank before it; nothing where there is none.
pub fn behind(unit: &str) -> String {
    if unit.is_empty() || unit == "1" { String::new() } else { format!(" {unit}") }
}

/// Share as a percentage.
pub fn percent(share: f64, digits: usize) -> String {
    format!("{} %", significant(100.0 * share, digits))
}

/// A number as [`significant`] writes it, as MathML: `<mn>2.5</mn>`, a power of ten as a power.
pub fn mathml_number(text: &str) -> String {
    let mn = |t: &str| match t.strip_prefix('−') {
        Some(rest) => format!("<mo>−</mo><mn>{rest}</mn>"),
        None => format!("<mn>{t}</mn>"),
    };
    let Some((digits, power)) = text.split_once("·10") else { return mn(text) };
    let exponent = (-400..400).find(|e| superscript(*e) == power).unwrap_or(0);
    let exponent = fixed(f64::from(exponent), 0);
    format!("{}<mo>·</mo><msup><mn>10</mn><mrow>{}</mrow></msup>", mn(digits), mn(&exponent))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_follow_the_uncertainty() {
        assert_eq!(plus_minus(0.113_123_456, 0.000_042), "0.11312 ± 0.00004");
        assert_eq!(plus_minus(1.6816, 0.0123), "1.682 ± 0.012");
        assert_eq!(plus_minus(5.99e-4, 3.1e-6), "(5.990 ± 0.031)·10⁻⁴");
        assert_eq!(plus_minus(-0.0004, 0.0021), "−0.0004 ± 0.0021");
        assert_eq!(plus_minus(172.71, 0.98), "172.7 ± 1.0");
        assert_eq!(plus_minus(123_456.0, 700.0), "(1.235 ± 0.007)·10⁵");
        assert_eq!(plus_minus(0.25, 0.0), "0.25000");
        assert!(plus_minus(1.0, 1e-300).len() < 60 && plus_minus(1e300, 1e-300).len() < 60);
        assert_eq!(to_digits_of(0.1131, 0.000_042), "0.11310");
        assert_eq!(to_digits_of(5.99e-4, 3.1e-6), "5.990·10⁻⁴");
    }

    #[test]
    fn a_least_value_is_not_told_as_less() {
        for (x, told) in [(0.534_045, 0.535), (1.067, 1.07), (0.32, 0.32), (9.999, 10.0), (1.000_1e-4, 1.01e-4)] {
            assert!(
                (rounded_up(x, 3) / told - 1.0).abs() < 1e-12 && rounded_up(x, 3) >= x,
                "{x}: {}",
                rounded_up(x, 3)
            );
        }
    }

    #[test]
    fn plain_numbers() {
        assert_eq!(significant(0.000_123_4, 3), "1.23·10⁻⁴");
        assert_eq!(significant(-12.3456, 3), "−12.3");
        assert_eq!(significant(0.099_99, 2), "0.10");
        assert_eq!(significant(1_234_567.0, 3), "1.23·10⁶");
        assert_eq!(significant(0.0, 3), "0");
        assert_eq!(fixed(-0.001, 2), "0.00");
        assert_eq!(count(1_800_000), "1\u{202f}800\u{202f}000");
        assert_eq!(count(1024), "1024");
        assert_eq!(duration(120.0), "120.0 s");
        assert_eq!(duration(3603.2), "1 h 0 min 3 s");
        assert_eq!(duration(0.002), "2.00 ms");
        assert_eq!(["0.534 s", "4.00 s", "4.45·10⁻⁴ s"], [0.534_05, 4.0, 4.4543e-4].map(in_seconds));
        assert_eq!(instant(12.0, 0.002), "12.000");
        assert_eq!(instant(2.508e-4, 3.3e-6), "0.000251");
        assert_eq!(instant(-0.5, 0.0), "−0.500");
        assert_eq!(quantity(4.43e-4, "rad", 2), "443 µrad");
        assert_eq!(quantity(0.015_525, "m", 4), "15.53 mm");
        assert_eq!(quantity(500.0, "Hz", 3), "500 Hz");
        assert_eq!((behind("N m").as_str(), behind("1").as_str(), behind("").as_str()), (" N m", "", ""));
        assert_eq!(
            mathml_number("2.00·10⁻⁷"),
            "<mn>2.00</mn><mo>·</mo><msup><mn>10</mn><mrow><mo>−</mo><mn>7</mn></mrow></msup>"
        );
    }
}
