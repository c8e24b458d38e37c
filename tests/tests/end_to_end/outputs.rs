//! Outputs are checked before anything runs: none is an input or another output, none replaces a
//! record unasked, and each can be written.

use std::path::Path;

use super::program::{command, done, rig_file, whirl};

/// A folder with `rig.toml` and `r.csv` and `r.parquet`, 12 s each.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 1.0")]);
    for record in ["r.csv", "r.parquet"] {
        done(at, &format!("simulate --rig rig.toml --seconds 12 --seed 1 -o {record}"));
    }
    folder
}

/// Every file of a folder with its bytes, by name.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap())
        .filter(|e| e.path().is_file())
        .map(|e| (e.file_name().to_string_lossy().into_owned(), std::fs::read(e.path()).unwrap()))
        .collect();
    all.sort();
    all
}

/// The command ends with status 2 and one line with all of `parts`; no file has changed, come or
/// gone.
fn refused(folder: &Path, arguments: &str, parts: &[&str]) {
    let before = contents(folder);
    let run = whirl(folder, arguments);
    assert_eq!((run.status, run.stdout.as_str()), (2, ""), "{arguments}: {run:?}");
    assert_eq!(run.stderr.trim_end().lines().count(), 1, "{arguments}: {}", run.stderr);
    for part in parts {
        assert!(run.stderr.contains(part), "{arguments}: no \"{part}\" in: {}", run.stderr);
    }
    assert!(contents(folder) == before, "{arguments} changed the folder");
}

#[test]
fn a_record_that_is_there_is_replaced_with_force_alone() {
    let folder = folder();
    let at = folder.path();
    for record in ["r.csv", "r.parquet"] {
        let there = ["-o", record, "a record that is there already", "--force"];
        refused(at, &format!("simulate --rig rig.toml --seconds 1 -o {record}"), &there);
        refused(at, &format!("capture --from sim --rig rig.toml --seconds 1 -o {record}"), &there);
    }
    // Whatever its name, and for results as well.
    std::fs::copy(at.join("r.parquet"), at.join("model.toml")).unwrap();
    refused(at, "identify r.csv --rig rig.toml -o model.toml", &["-o", "a record that is there already", "--force"]);
    refused(at, "simulate --rig rig.toml --seconds 1 -o q.xlsx", &["q.xlsx", "-o", ".parquet, .csv, .csv.gz"]);
    refused(at, "capture --from sim --rig rig.toml --seconds 1 -o q.mat", &["q.mat", "-o", ".parquet, .csv, .csv.gz"]);
    std::fs::copy(at.join("rig.toml"), at.join("other.toml")).unwrap();
    refused(at, "identify r.csv --rig rig.toml -o other.toml", &["-o", "a rig file that is there already"]);
    refused(at, "inspect r.csv --rig rig.toml --json r.parquet", &["--json", "a record that is there already"]);
    std::fs::write(at.join("n.parquet.estimates.jsonl"), "{}\n").unwrap();
    refused(
        at,
        "capture --from sim --rig rig.toml --seconds 1 -o n.parquet",
        &["n.parquet.estimates.jsonl", "--force"],
    );
    done(at, "simulate --rig rig.toml --seconds 1 -o r.csv --force");
    assert_eq!(std::fs::read_to_string(at.join("r.csv")).unwrap().lines().count(), 501);
    done(at, "capture --from sim --rig rig.toml --seconds 1 -o r.parquet --force");
    // Results of whirl's own are replaced as they always were.
    for _ in 0..2 {
        done(at, "capture --from sim --rig rig.toml --seconds 5 -o new.csv --json out.json --report out.html");
        std::fs::remove_file(at.join("new.csv")).unwrap();
        let _ = std::fs::remove_file(at.join("new.csv.estimates.jsonl"));
    }
}

#[test]
fn a_record_is_made_again_from_its_own_journal() {
    let folder = folder();
    let at = folder.path();
    done(at, "capture --from sim --rig rig.toml --seconds 2 -o k.parquet --keep-frames");
    let first = std::fs::read(at.join("k.parquet")).unwrap();
    // A journal that was to be kept is no reason to replace a record unasked, and is kept whatever
    // is made of it.
    let journal = std::fs::read(at.join("k.parquet.frames")).unwrap();
    let again = "capture --from file:k.parquet.frames --rig rig.toml -o k.parquet";
    for more in ["", " --seconds 1"] {
        refused(at, &format!("{again}{more}"), &["k.parquet", "a record that is there already", "--force"]);
    }
    done(at, &format!("{again} --force"));
    assert!(first == std::fs::read(at.join("k.parquet")).unwrap());
    std::fs::remove_file(at.join("k.parquet")).unwrap();
    let _ = std::fs::remove_file(at.join("k.parquet.estimates.jsonl"));
    done(at, again);
    assert!(first == std::fs::read(at.join("k.parquet")).unwrap());
    refused(at, "capture --from sim --rig rig.toml -o k.parquet --force", &["k.parquet.frames", "was to be kept"]);
    assert!(journal == std::fs::read(at.join("k.parquet.frames")).unwrap());
    refused(at, "capture --from file:k.parquet.frames --rig rig.toml -o r.parquet", &["r.parquet", "--force"]);
    let own = ["a file that this command reads"];
    refused(at, "capture --from file:k.parquet.frames --rig rig.toml -o k.parquet.frames --force", &own);
}

#[test]
fn no_output_is_an_input() {
    let folder = folder();
    let at = folder.path();
    std::fs::hard_link(at.join("r.csv"), at.join("hard.json")).unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink("r.csv", at.join("soft.json")).unwrap();
    #[cfg(not(unix))]
    std::fs::hard_link(at.join("r.csv"), at.join("soft.json")).unwrap();
    done(at, "identify r.csv --rig rig.toml -o model.toml");
    let read = |option: &'static str| [option, "a file that this command reads"];
    for arguments in ["-o r.csv", "-o ./r.csv", "-o rig.toml"] {
        refused(at, &format!("identify r.csv --rig rig.toml {arguments} --force"), &read("-o"));
    }
    for name in ["r.csv", "hard.json", "soft.json", "rig.toml", &at.join("r.csv").display().to_string()] {
        for command in ["identify", "inspect", "reduce", "explain", "validate --model model.toml"] {
            refused(at, &format!("{command} r.csv --rig rig.toml --json {name}"), &read("--json"));
            refused(at, &format!("{command} r.csv --rig rig.toml --report {name}"), &read("--report"));
        }
    }
    refused(at, "explain r.csv --rig rig.toml --model model.toml -o model.toml", &read("-o"));
    refused(at, "explain r.csv --rig rig.toml --ledger r.csv", &read("--ledger"));
    refused(at, "reduce r.csv --rig rig.toml --curves r.csv", &read("--curves"));
    refused(at, "validate r.csv --rig rig.toml --model model.toml --free r.parquet --json r.parquet", &read("--json"));
    refused(at, "simulate --rig rig.toml --seconds 1 -o rig.toml --force", &read("-o"));
    // The model file that a rig names is an input, too.
    std::fs::write(at.join("m.toml"), MODEL).unwrap();
    std::fs::write(at.join("own.toml"), RIG).unwrap();
    refused(at, "simulate --rig own.toml --seconds 1 -o o.csv --json m.toml", &read("--json"));
}

const MODEL: &str = "name = \"m\"\ncoordinates = [{ name = \"x\", space = \"R\" }]\n\
    [[equation]]\nbalance = \"-x''\"\nterms = { c = \"x'\", k = \"x\" }\n";
const RIG: &str = "name = \"r\"\nmodel = \"m.toml\"\nsample_rate_hz = 100.0\n\
    [[channel]]\nname = \"x\"\nmeasures = \"x\"\nunit = \"m\"\n\
    [plant]\nc = 0.5\nk = 40.0\ninitial = [0.1, 0.0]\n";

#[test]
fn no_output_is_another() {
    let folder = folder();
    let at = folder.path();
    refused(at, "identify r.csv --rig rig.toml -o x --json ./x", &["-o", "the file of --json"]);
    refused(at, "identify r.csv --rig rig.toml --report x --json x", &["--report", "the file of --json"]);
    refused(at, "simulate --rig rig.toml --seconds 1 -o n.csv --json n.csv", &["-o", "the file of --json"]);
    let capture = "capture --from sim --rig rig.toml --seconds 1 -o n.parquet --json";
    refused(at, &format!("{capture} n.parquet"), &["-o", "the file of --json"]);
    refused(at, &format!("{capture} n.parquet.frames"), &["n.parquet.frames", "the file of --json"]);
    refused(at, &format!("{capture} n.parquet.estimates.jsonl"), &["the file of --json"]);
}

#[test]
fn an_output_is_a_file_in_a_folder_that_can_be_written_to() {
    let folder = folder();
    let at = folder.path();
    std::fs::create_dir(at.join("dir")).unwrap();
    for (name, part) in [("dir", "a folder"), ("no/x", "its folder does not exist"), ("r.csv/x", "r.csv/x")] {
        refused(at, &format!("simulate --rig rig.toml --seconds 1 -o {name}"), &["-o", part]);
        refused(at, &format!("capture --from sim --rig rig.toml --seconds 1 -o {name}"), &["-o", part]);
        refused(at, &format!("explain r.csv --rig rig.toml -o {name}"), &["-o", part]);
        refused(at, &format!("explain r.csv --rig rig.toml --json {name}"), &["--json", part]);
        refused(at, &format!("reproduce table-2.1 --report {name}"), &["--report", part]);
    }
    for (command, option) in [
        ("simulate --rig rig.toml --seconds 1 -o -", "-o"),
        ("capture --from sim --rig rig.toml --seconds 1 -o -", "-o"),
        ("identify r.csv --rig rig.toml -o -", "-o"),
        ("identify r.csv --rig rig.toml --report -", "--report"),
        ("explain r.csv --rig rig.toml --ledger -", "--ledger"),
        ("reduce r.csv --rig rig.toml --curves -", "--curves"),
    ] {
        refused(at, command, &[option, "Name a file"]);
    }
    assert!(!at.join("-").exists());
    let printed = done(at, "identify r.csv --rig rig.toml --json -");
    assert!(printed.starts_with("{\n  \"format\": 1,\n  \"model\""), "{printed}");
    // A device takes results as it always did.
    #[cfg(unix)]
    {
        done(at, "identify r.csv --rig rig.toml --json /dev/null --report /dev/null");
        assert!(done(at, "identify r.csv --rig rig.toml --json /dev/stdout").contains("\"model\""));
    }
}

#[cfg(unix)]
#[test]
fn what_is_no_regular_file_is_refused_at_once() {
    let folder = folder();
    let at = folder.path();
    let pipe = at.join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let to_file = "Save it to a file first";
    for (name, kind) in [("pipe", "a pipe"), ("/dev/zero", "a device"), (".", "a folder")] {
        refused(at, &format!("identify {name} --rig rig.toml"), &[kind, "a record"]);
        refused(at, &format!("inspect r.csv {name} --rig rig.toml"), &[kind, "a record"]);
        refused(at, &format!("identify r.csv --rig {name}"), &[kind, "a rig file"]);
        refused(at, &format!("validate r.csv --rig rig.toml --model {name}"), &[kind, "an identified model"]);
        refused(at, &format!("capture --from file:{name} --rig rig.toml -o n.csv"), &[kind, "bytes of the wire"]);
    }
    std::fs::write(at.join("own.toml"), RIG.replace("m.toml", "/dev/zero")).unwrap();
    refused(at, "identify r.csv --rig own.toml", &["/dev/zero", "a device", "a model file", to_file]);
    std::fs::write(at.join("own.toml"), RIG.replace("m.toml", "./pipe")).unwrap();
    refused(at, "identify r.csv --rig own.toml", &["pipe", "a pipe", "a model file", to_file]);
}

/// A full standard error or output ends nothing but the line.
#[cfg(target_os = "linux")]
#[test]
fn full_standard_streams_do_not_end_in_a_panic() {
    let folder = folder();
    let at = folder.path();
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let run = |arguments: &str| {
        let mut c = command();
        c.current_dir(at).args(arguments.split_whitespace());
        c
    };
    // 12 s give warnings; the answer is there all the same.
    let out = run("identify r.csv --rig rig.toml --json out.json").stderr(full()).output().unwrap();
    assert!(matches!(out.status.code(), Some(0 | 1)) && at.join("out.json").exists(), "{out:?}");
    let out = run("identify none.csv --rig rig.toml").stderr(full()).output().unwrap();
    assert_eq!(out.status.code(), Some(2));
    for arguments in ["identify r.csv --rig rig.toml", "list models", "completions bash", "--help"] {
        let out = run(arguments).stdout(full()).output().unwrap();
        let told = String::from_utf8(out.stderr).unwrap();
        assert!(!told.contains("panicked"), "{arguments}: {told}");
        assert!(arguments == "--help" || (out.status.code() == Some(2) && told.contains("standard output")), "{told}");
    }
}

/// What files say never reaches a terminal as it stands, and one message is one line.
#[test]
fn control_characters_are_shown() {
    let folder = folder();
    let at = folder.path();
    let text = std::fs::read_to_string(at.join("rig.toml")).unwrap();
    for (name, from, to) in [
        ("key.toml", "sample_rate_hz", "\"\\u001b[2J\\nwhirl: all is well\""),
        ("model.toml", "\"double-pendulum\"", "\"\\u001b]0;x\\u0007\\n\\u009b\\u202e\""),
        ("unit.toml", "unit = \"count\"", "unit = \"\\u001b[31m\\ncount\""),
        ("known.toml", "m2 = 0.040\n", "\"\\u001b[2J\\n\" = 0.040\n"),
        ("measures.toml", "measures = \"theta1\"", "measures = \"\\u0007theta1\\r\""),
        ("long.toml", "unit = \"count\"", &format!("unit = \"{}\"", "x".repeat(100_000))),
        ("number.toml", "sample_rate_hz = 500.0", "sample_rate_hz = 1e300"),
    ] {
        assert!(text.contains(from));
        std::fs::write(at.join(name), text.replacen(from, to, 1)).unwrap();
        for command in ["identify", "inspect"] {
            let run = whirl(at, &format!("{command} r.csv --rig {name}"));
            let line = run.stderr.strip_suffix('\n').unwrap();
            assert_eq!(run.status, 2, "{name}: {run:?}");
            assert!(!line.contains(|c: char| c.is_control() || c == '\u{202e}'), "{name}: {line:?}");
            assert!(line.chars().count() < 1200, "{name}: {line}");
        }
    }
    assert!(whirl(at, "identify r.csv --rig number.toml").stderr.contains("found 1e300, expected"));
    #[cfg(unix)]
    {
        let out =
            command().current_dir(at).args(["identify", "new\nline\u{1b}.csv", "--rig", "rig.toml"]).output().unwrap();
        let told = String::from_utf8(out.stderr).unwrap();
        assert_eq!(told.lines().count(), 1, "{told}");
        assert!(told.contains("new\\nline\\u{1b}.csv: No such file"), "{told}");
    }
}
