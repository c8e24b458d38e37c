//! An uneven clock made even, on request: values at even times by the cubic through the four
//! nearest samples.
//!
//! For samples taken at times that are known but not even. Between gaps (differences above 2.5
//! steps) the times are first, first + step …; counts become values in counts, (c + ½). The cubic's
//! error is (Δt)⁴ q⁗/40 or so: it needs a signal well below the Nyquist frequency, which the
//! warning says.

use super::Column;
use super::rows::Rows;
use crate::signal::lagrange;
use crate::warning::Warning;

/// Steps between neighbours from which there is a gap.
const GAP: f64 = 2.5;

/// Resamples rows to the rig's rate.
pub(super) fn even(rows: &mut Rows<'_>, warnings: &mut Vec<Warning>) {
    let step = 1.0 / rows.rig.sample_rate_hz;
    let mut holes: Vec<usize> = rows.missing.iter().flatten().copied().collect();
    holes.sort_unstable();
    holes.dedup();
    let good: Vec<usize> = (0..rows.t.len()).filter(|i| holes.binary_search(i).is_err()).collect();
    let values: Vec<Vec<f64>> = rows
        .columns
        .iter()
        .map(|c| match c {
            Column::Counts(x) => good.iter().map(|&i| f64::from(x[i]) + 0.5).collect(),
            Column::Values(x) => good.iter().map(|&i| x[i]).collect(),
        })
        .collect();
    let t: Vec<f64> = good.iter().map(|&i| rows.t[i]).collect();
    let (mut times, mut out) = (Vec::new(), vec![Vec::new(); values.len()]);
    let (mut from, mut worst) = (0, 0.0_f64);
    for i in 1..=t.len() {
        if i < t.len() && t[i] - t[i - 1] <= GAP * step {
            worst = worst.max((t[i] - t[i - 1] - step).abs());
            continue;
        }
        if i - from >= 4 {
            let count = ((t[i - 1] - t[from]) / step + 1e-9).floor() as usize + 1;
            let mut k = from;
            for n in 0..count {
                let at = t[from] + n as f64 * step;
                while k + 1 < i && t[k + 1] <= at {
                    k += 1;
                }
                let first = k.saturating_sub(1).clamp(from, i - 4);
                times.push(at);
                for (column, x) in out.iter_mut().zip(&values) {
                    column.push(cubic(&t[first..first + 4], &x[first..first + 4], at));
                }
            }
        }
        from = i;
    }
    warnings.push(Warning::new(
        "resampled",
        format!(
            "{} rows were resampled to {} at {} Hz; differences of t departed from it by up to {:.1} % of a step",
            t.len(),
            times.len(),
            rows.rig.sample_rate_hz,
            100.0 * worst / step
        ),
        "Cubics between the samples: right well below the Nyquist frequency only. Sample evenly where you can",
    ));
    rows.t = times;
    rows.columns = out.into_iter().map(Column::Values).collect();
    rows.missing.iter_mut().for_each(Vec::clear);
    rows.device = None;
}

/// Lagrange's cubic.
fn cubic(t: &[f64], x: &[f64], at: f64) -> f64 {
    lagrange::weights(t, at).zip(x).map(|(w, x)| x * w).sum()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use crate::record::{ReadOptions, Record};
    use crate::rig::Rig;

    #[test]
    fn a_jittering_clock_is_reported_and_mended_on_request_only() {
        let text = "name = \"x\"\nmodel = \"other\"\nsample_rate_hz = 100.0\n[[channel]]\nname = \"q\"\nmeasures = \"q\"\nunit = \"m\"\n";
        let rig = Rig::parse(text, Path::new("rig.toml")).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r.csv");
        let write = |jitter: f64| {
            let mut csv = "t,q\n".to_owned();
            for i in (0..1000).filter(|i| !(500..520).contains(i)) {
                let t = 0.01 * f64::from(i) + jitter * (f64::from(i) * 2.3).sin();
                csv += &format!("{t},{}\n", (3.0 * t).sin());
            }
            std::fs::write(&path, csv).unwrap();
        };
        // So uneven that rows seem to miss.
        write(0.003);
        let message = Record::read(&path, &rig, &ReadOptions::default()).unwrap_err().to_string();
        assert!(message.contains("--resample"), "{message}");
        write(0.001);
        let plain = Record::read(&path, &rig, &ReadOptions::default()).unwrap();
        assert!(
            plain.warnings.iter().any(|w| w.id == "jitter" && w.advice.contains("--resample")),
            "{:?}",
            plain.warnings
        );
        let options = ReadOptions { resample: true, ..ReadOptions::default() };
        let even = Record::read(&path, &rig, &options).unwrap();
        assert!(even.warnings.iter().any(|w| w.id == "resampled") && !even.warnings.iter().any(|w| w.id == "jitter"));
        assert_eq!((even.segments.len(), even.losses.gaps), (2, 1));
        for s in &even.segments {
            for (i, x) in s.columns[0].angle(&rig.channel[0]).iter().enumerate() {
                assert!((x - (3.0 * s.time(i)).sin()).abs() < 1e-5, "{x}");
            }
        }
    }
}
