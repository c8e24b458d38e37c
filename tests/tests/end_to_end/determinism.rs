//! Same input, same seed, same bytes out, whatever the number of threads.

use std::path::Path;

use super::program::{rig_file, whirl};

/// Every file in a folder, by name.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            all.extend(files(&path).into_iter().map(|(n, b)| (format!("{name}/{n}"), b)));
        } else {
            all.push((name, std::fs::read(path).unwrap()));
        }
    }
    all.sort();
    all
}

#[test]
fn the_same_command_gives_the_same_bytes_with_one_and_with_two_threads() {
    let run = |threads: u32| {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 2.0")]);
        let mut printed = Vec::new();
        for command in [
            "simulate --rig rig.toml --seconds 12 --seed 3 --effect quadratic-drag@arm2=2e-7 -o simulated.parquet --json simulate.json",
            "simulate --rig rig.toml --seconds 5 --seed 3 -o simulated.csv",
            "capture --from sim:3 --rig rig.toml --seconds 20 -o captured.parquet --keep-frames --json capture.json --report capture.html",
            "inspect captured.parquet --rig rig.toml --json inspect.json --report inspect.html",
            "identify captured.parquet simulated.parquet --rig rig.toml --json identify.json --report identify.html",
            "identify captured.parquet --rig rig.toml --json -",
            "explain simulated.parquet --rig rig.toml -o model.toml --json explain.json --report explain.html",
            "validate simulated.parquet --rig rig.toml --model model.toml --json validate.json",
        ] {
            // A hidden effect makes some answers negative.
            let run = whirl(at, &format!("{command} --threads {threads}"));
            assert!(run.status < 2, "{command}: {run:?}");
            printed.push(run.stdout);
        }
        (printed, files(at))
    };
    let (one, two) = (run(1), run(2));
    assert!(one.1.len() >= 15, "{:?}", one.1.iter().map(|f| &f.0).collect::<Vec<_>>());
    assert_eq!(one.0, two.0);
    for (x, y) in one.1.iter().zip(&two.1) {
        assert!(x == y, "{} and {} differ", x.0, y.0);
    }
    assert_eq!(one.1.len(), two.1.len());
}
