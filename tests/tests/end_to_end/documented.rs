//! Every `whirl` command in README and docs is run as it stands there: in a folder with the files
//! that its page speaks of, with shorter records.
//!
//! Blocks are run page by page, line by line. What needs a device or a terminal must come as far as
//! saying that there is none; what is named within the text must name a command and options that
//! there are. Other commands (`cargo`, `snakemake`, …) are `./check`'s own steps.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use whirl_tests::repository;

use super::program::{Run, done, rig_file, whirl};

/// What is replaced in a command, so that it is short: from, to.
const SHORTER: [(&str, &str); 11] = [
    // What is found in the whole of them `measured.rs` and `own_systems.rs` ask.
    ("csv.gz --rig rigs", "csv.gz --to 12 --rig rigs"),
    ("--seconds 120", "--seconds 30"),
    ("--seconds 60", "--seconds 24"),
    ("serial:/tmp/whirl-rig", "sim"),
    ("tcp:127.0.0.1:5000", "sim"),
    ("whirl batch explain records/*.parquet", "whirl batch explain --most-effects 1 records/1.parquet"),
    ("--most-effects 2 ", ""),
    ("whirl explain", "whirl explain --most-effects 1"),
    // Half a minute of simulations, which `planned.rs` and `json_page.rs` run; its options are
    // looked at below.
    ("whirl plan --rig", "whirl plan --help # --rig"),
    ("--plan plan.toml", "--plan short.toml"),
    ("whirl batch validate records/*.parquet", "whirl batch validate --starts 4 records/1.parquet"),
];

/// Commands that end with status 2 here, and what they say.
const WITHOUT: [(&str, &str); 8] = [
    ("--from serial:/dev/ttyACM0", "/dev/ttyACM0"),
    ("--live", "run1.parquet"),
    ("whirl device show", "board"),
    ("whirl device set", "board"),
    ("whirl device zero", "board"),
    ("$WHIRL_RECORDS/multiarm", "multiarm"),
    ("$WHIRL_RECORDS/emps", "emps"),
    ("$WHIRL_RECORDS/silverbox", "silverbox"),
];

/// Pages with commands in them.
fn pages() -> Vec<PathBuf> {
    let mut all = vec![repository("README.md"), repository("CONTRIBUTING.md")];
    let mut folders = vec![repository("docs")];
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                all.push(path);
            }
        }
    }
    all.sort();
    all
}

/// The `whirl` commands of a page's blocks, in their order, without what stands behind `#`.
fn commands(text: &str) -> Vec<String> {
    let blocks = text.split("```").skip(1).step_by(2);
    let lines = blocks.flat_map(|block| block.lines().skip(1));
    let line = |l: &str| l.split(" # ").next().unwrap_or_default().trim().to_owned();
    lines.map(line).filter(|l| l.starts_with("whirl ") && !l.contains('…')).collect()
}

/// `whirl` commands within the text.
fn inline(text: &str) -> Vec<String> {
    let prose: String = text.split("```").step_by(2).collect();
    let code = prose.split('`').skip(1).step_by(2).map(|c| c.split_whitespace().collect::<Vec<_>>().join(" "));
    code.filter(|c| c.starts_with("whirl ") && !c.contains('…')).collect()
}

/// Files that a page shows whole: blocks of TOML whose first line is a comment with the file's
/// name alone.
fn files(text: &str) -> Vec<(&str, &str)> {
    let blocks = text.split("```").skip(1).step_by(2);
    let named = blocks.filter_map(|block| {
        let body = block.strip_prefix("toml\n")?;
        let name = body.lines().next()?.strip_prefix("# ")?;
        (name.ends_with(".toml") && !name.contains(['/', ' '])).then_some((name, body))
    });
    named.collect()
}

/// A folder with what a page of this name and text speaks of.
fn prepared(page: &str, text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for sub in ["rigs", "models", "records", "bin"] {
        std::fs::create_dir(at.join(sub)).unwrap();
    }
    let shipped = [
        "rigs/measured-double-pendulum.toml",
        "rigs/emps.toml",
        "rigs/emps-viscous.toml",
        "rigs/duffing.toml",
        "rigs/silverbox-linear.toml",
        "rigs/two-mass.toml",
        "rigs/two-mass-model-file.toml",
        "models/two-mass.toml",
        "models/positioning-drive.toml",
        "models/positioning-drive-viscous.toml",
        "models/duffing.toml",
        "models/oscillator.toml",
    ];
    for name in shipped {
        std::fs::copy(repository(name), at.join(name)).unwrap();
    }
    for (name, content) in files(text) {
        std::fs::write(at.join(name), content).unwrap();
    }
    for name in ["chaotic.toml", "seed.toml", "measured-base.toml"] {
        rig_file(&at.join("rigs"), name, name, &[("settle_s = 20.0", "settle_s = 1.0")]);
    }
    std::os::unix::fs::symlink(env!("CARGO_BIN_EXE_whirl-under-test"), at.join("bin/whirl")).unwrap();
    let rig = "--rig rigs/chaotic.toml";
    match page {
        "batch.md" => {
            std::fs::copy(at.join("rigs/chaotic.toml"), at.join("rig.toml")).unwrap();
            for seed in [1, 2] {
                done(at, &format!("simulate {rig} --seconds 24 --seed {seed} -o records/{seed}.parquet"));
            }
            done(at, &format!("identify records/1.parquet {rig} --method weak -o model.toml"));
        }
        "excitation.md" => {
            // The page makes its table by itself.
            let table = text.lines().find(|line| line.starts_with("seq ")).unwrap();
            assert_eq!(run(at, table).status, 0);
        }
        "record-format.md" => drop(done(at, &format!("simulate {rig} --seconds 24 --seed 1 -o run.csv"))),
        "plan.md" => {
            let run = "frequency_hz = 5.0\namplitude_m = 0.0115\nseconds = 1.0\npose = [0.1, 0.2]\n[run.std_errors]\nC2 = 0.1\n";
            std::fs::write(at.join("short.toml"), format!("format = 1\nrig = \"x\"\n[[run]]\n{run}")).unwrap();
        }
        _ => {}
    }
    folder
}

fn run(at: &Path, command: &str) -> Run {
    let path = std::env::var("PATH").unwrap_or_default();
    let path = format!("{}:{path}", at.join("bin").display());
    let output = Command::new("sh").current_dir(at).args(["-c", command]).env("PATH", path).output().unwrap();
    Run::from(output)
}

/// Runs the blocks of a page; how many commands, and what was wrong.
fn tried(page: &Path) -> (usize, Vec<String>) {
    let name = page.file_name().unwrap().to_string_lossy().into_owned();
    let text = std::fs::read_to_string(page).unwrap();
    let all = commands(&text);
    if all.is_empty() {
        return (0, vec![]);
    }
    let folder = prepared(&name, &text);
    let mut wrong = Vec::new();
    for command in &all {
        let mut short = command.clone();
        SHORTER.iter().for_each(|(from, to)| short = short.replace(from, to));
        let run = run(folder.path(), &short);
        let fine = match WITHOUT.iter().find(|(part, _)| command.contains(part)) {
            Some((_, says)) => run.status < 2 || (run.stderr.contains(says) && !run.stderr.contains("Usage")),
            // A record so short may leave an answer open.
            None => run.status < 2,
        };
        if !fine {
            wrong.push(format!("{name}: {command}: status {}: {}", run.status, run.stderr.trim()));
        }
    }
    (all.len(), wrong)
}

#[test]
fn every_command_of_the_pages_runs() {
    let pages = pages();
    let tried: Vec<(usize, Vec<String>)> = std::thread::scope(|scope| {
        let threads: Vec<_> = pages.iter().map(|page| scope.spawn(|| tried(page))).collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect()
    });
    let count: usize = tried.iter().map(|(n, _)| n).sum();
    let wrong: Vec<String> = tried.into_iter().flat_map(|(_, w)| w).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count >= 25, "{count} commands");
}

#[test]
fn commands_and_options_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let mut help: BTreeMap<String, Run> = BTreeMap::new();
    let (mut wrong, mut count) = (Vec::new(), 0);
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        for command in inline(&text).into_iter().chain(commands(&text)) {
            count += 1;
            let words: Vec<&str> = command.split(' ').skip(1).collect();
            let called = words
                .iter()
                .take_while(|w| w.chars().all(|c| c.is_ascii_lowercase() || c == '-') && !w.starts_with('-'));
            // Of `batch merge` and `device set` the second word is a command too.
            let most = if ["batch", "device", "list"].contains(words.first().unwrap_or(&"")) { 2 } else { 1 };
            let sub = called.take(most).copied().collect::<Vec<_>>().join(" ");
            let run = help.entry(sub.clone()).or_insert_with(|| whirl(folder.path(), &format!("{sub} --help")));
            if run.status != 0 {
                wrong.push(format!("{}: {command}: no command {sub}", page.display()));
            }
            let options =
                words.iter().map(|w| w.trim_matches(|c| "[]()|,.;".contains(c)).split('=').next().unwrap_or_default());
            for option in options.filter(|w| w.starts_with("--") && w.len() > 2) {
                if !run.stdout.contains(option) {
                    wrong.push(format!("{}: {command}: no option {option}", page.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(count > 60, "{count}");
}
