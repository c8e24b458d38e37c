//! Models that leave as code: what the code computes is held against whirl's own simulation, or
//! against golden files.

use std::io::Write;
use std::path::Path;
use std::process::Command;

use whirl_tests::repository;

use super::program::{done, json, rig_file, whirl};

/// A table read from CSV: names and rows.
struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn of(text: &str) -> Self {
        let mut lines = text.lines();
        let names = lines.next().expect("a header").split(',').map(str::to_owned).collect();
        let row = |l: &str| l.split(',').map(|c| c.parse().unwrap_or_else(|_| panic!("a number: {l}"))).collect();
        Self { names, rows: lines.map(row).collect() }
    }

    fn column(&self, name: &str) -> Vec<f64> {
        let k = self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no {name} in {:?}", self.names));
        self.rows.iter().map(|r| r[k]).collect()
    }
}

/// Runs a program and gives what it printed.
fn printed(folder: &Path, program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program)
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap_or_else(|e| panic!("{program} does not run ({e}): the exported code cannot be tried; install it"));
    assert!(output.status.success(), "{program} {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// Largest difference of two tables in some columns, of each column's largest value (of 1 at
/// least), over a second.
fn apart(a: &Table, b: &Table, columns: &[(&str, &str)]) -> f64 {
    assert_eq!((a.rows.len(), b.rows.len()), (501, 501), "a second at 500 Hz");
    let mut most = 0.0_f64;
    for (x, y) in columns {
        let (x, y) = (a.column(x), b.column(y));
        let size = y.iter().fold(1.0_f64, |m, y| m.max(y.abs()));
        most = x.iter().zip(&y).fold(most, |m, (x, y)| m.max((x - y).abs() / size));
    }
    most
}

/// The exported Python and C move as `simulate --model` does; `rig` is what goes behind both.
fn agrees(folder: &Path, model: &str, columns: &[(&str, &str)]) {
    done(folder, &format!("simulate --model {model} --seconds 1.002 -o own.csv --force --json own.json"));
    let own = Table::of(&std::fs::read_to_string(folder.join("own.csv")).unwrap());
    let exact = json(&folder.join("own.json"))["difference"].as_f64().unwrap();
    assert!(exact < 1e-10, "{model}: whirl's own solution is exact to {exact:e} only");
    done(folder, &format!("export {model} --to python -o model.py"));
    let python = apart(&Table::of(&printed(folder, "python3", &["model.py"])), &own, columns);
    done(folder, &format!("export {model} --to c -o model.c"));
    let flags =
        ["-std=c99", "-O1", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror", "-o", "model", "model.c", "-lm"];
    printed(folder, "cc", &flags);
    let binary = folder.join("model").display().to_string();
    let c = apart(&Table::of(&printed(folder, &binary, &[])), &own, columns);
    let _ = writeln!(std::io::stderr(), "{model}: Python apart by {python:.1e}, C by {c:.1e}");
    assert!(python < 1e-9 && c < 1e-9, "{model}: Python apart by {python:e}, C by {c:e}");
    octave(folder, model, &own, columns);
}

/// The same for MATLAB code in GNU Octave, over a tenth of a second, where there is one.
fn octave(folder: &Path, model: &str, own: &Table, columns: &[(&str, &str)]) {
    if Command::new("octave").arg("--version").output().is_err() {
        // Past the test harness's capture, so that it is seen.
        let _ = writeln!(std::io::stderr(), "{model}: MATLAB code did not run, GNU Octave is not installed");
        return;
    }
    done(folder, &format!("export {model} --to matlab -o exported.m"));
    let script = "[t, x] = exported(0.1, 1e-4); x = x(1:20:end, :); for i = 1:rows(x), printf('%.17g,', x(i, :)); printf('\\n'); end";
    let text = printed(folder, "octave", &["--no-gui", "--quiet", "--eval", script]);
    let rows: Vec<Vec<f64>> =
        text.lines().map(|l| l.trim_end_matches(',').split(',').map(|c| c.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 51, "{text}");
    for (k, (_, name)) in columns.iter().enumerate() {
        for (row, wanted) in rows.iter().zip(own.column(name)) {
            assert!((row[k] - wanted).abs() < 1e-9 * wanted.abs().max(1.0), "{model}, {name}: {} {wanted}", row[k]);
        }
    }
}

#[test]
fn an_identified_double_pendulum_leaves_as_code_that_moves_alike() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    rig_file(at, "chaotic.toml", "rig.toml", &[("settle_s = 20.0", "settle_s = 1.0")]);
    done(at, "simulate --rig rig.toml --seconds 24 --seed 1 -o r.parquet");
    done(at, "identify r.parquet --rig rig.toml -o model.toml");
    agrees(at, "model.toml", &[("phi1", "phi1"), ("phi2", "phi2")]);
    // From a record's state, it goes where the record goes, for a while; the drive's phase and the
    // columns are the record's.
    let said =
        done(at, "simulate --model model.toml --from r.parquet --start 5 --seconds 20 -o s.parquet --json s.json");
    assert!(said.contains("count1 (count), count2 (count)"), "{said}");
    done(at, "simulate --model model.toml --rig rig.toml --from r.parquet --start 5 --seconds 0.5 -o s.csv");
    done(at, "simulate --rig rig.toml --seconds 24 --seed 1 -o r.csv");
    let part = |name: &str, from: f64| {
        let table = Table::of(&std::fs::read_to_string(at.join(name)).unwrap());
        let t = table.column("t");
        let first = t.iter().position(|t| *t > from - 1e-6).unwrap();
        [table.column("count1")[first..first + 100].to_vec(), table.column("count2")[first..first + 100].to_vec()]
    };
    let (simulated, recorded) = (part("s.csv", 0.0), part("r.csv", 5.0));
    for (s, r) in simulated.iter().zip(&recorded) {
        assert!(s.iter().zip(r).all(|(s, r)| (s - r).abs() <= 4.0), "{s:?} {r:?}");
    }
    // What was simulated is a record of the same rig.
    done(at, "identify s.parquet --rig rig.toml --json i.json");
    let i = json(&at.join("i.json"));
    let b21 = |v: &serde_json::Value| {
        v["parameters"].as_array().unwrap().iter().find(|p| p["name"] == "B21").unwrap()["value"].as_f64().unwrap()
    };
    let text = std::fs::read_to_string(at.join("model.toml")).unwrap();
    let (_, value) = text.split_once("B21 = { value = ").unwrap();
    let wanted: f64 = value.split(',').next().unwrap().parse().unwrap();
    assert!((b21(&i) / wanted - 1.0).abs() < 2e-3, "{} {wanted}", b21(&i));
}

#[test]
fn an_explained_double_pendulum_leaves_with_its_effects() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::copy(repository("tests/golden/export/double-pendulum.toml"), at.join("double.toml")).unwrap();
    // What encoder 2 adds is in whirl's record and not in the state: taken off here.
    let text = std::fs::read_to_string(at.join("double.toml")).unwrap();
    std::fs::write(at.join("model.toml"), text.replace("strengths = [0.01]", "strengths = [0.0]")).unwrap();
    agrees(at, "model.toml", &[("phi1", "phi1"), ("phi2", "phi2")]);
    let code = std::fs::read_to_string(at.join("model.py")).unwrap();
    for part in [
        "quadratic-drag@arm2: −k ω |ω|; value 2e-7 N m s², standard error 5.0e-10",
        "standard error 2.1e-5",
        "OMEGA = 31.41",
    ] {
        assert!(code.contains(part), "no {part} in {code}");
    }
}

#[test]
fn systems_of_ones_own_leave_as_code_that_moves_alike() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::copy(repository("tests/golden/export/oscillator.toml"), at.join("model.toml")).unwrap();
    agrees(at, "model.toml", &[("x_", "x")]);
    // Written equations with an interpolation basis (small: where a hat bends, no step of order 4
    // is one) and dry friction at two coordinates.
    std::fs::write(
        at.join("own.toml"),
        "name = \"a cart with \\\"all\\\" \\\\\"\nmethod = \"weak\"\nnominal = []\n\
         coordinates = [{ name = \"x\", space = \"R\" }, { name = \"theta\", space = \"S1\" }]\ninputs = [\"force\"]\n\
         [[equation]]\nbalance = \"force - 2*x''\"\nterms = { mass = \"x''\", step = \"theta''*cos(theta) - theta'^2*sin(theta)\", tau_x = \"sign(x')\", k = \"x\" }\n\
         [[equation]]\nbalance = \"-theta''\"\nterms = { lambda = \"x''*cos(theta)\", g = \"sin(theta)\", s = \"sign(2*theta')\", \
         f = { basis = \"interpolation\", of = \"theta\", points = 8 }, w = \"theta\" }\n[parameters]\n\
         mass = { value = 1.2 }\nstep = { value = 0.3 }\ntau_x = { value = 0.5 }\nk = { value = 30.0 }\nlambda = { value = 0.8 }\ng = { value = 41.0 }\n\
         s = { value = 0.7 }\nf_1 = { value = 0.001 }\nf_2 = { value = -0.004 }\nf_3 = { value = 0.002 }\nf_4 = { value = 0.001 }\nf_5 = { value = 0.003 }\n\
         f_6 = { value = -0.002 }\nf_7 = { value = 0.0005 }\nf_8 = { value = 0.006 }\nw = { value = 2.0 }\n",
    )
    .unwrap();
    agrees(at, "own.toml", &[("x_", "x"), ("theta", "theta")]);
    // Derived from bodies.
    rig_file(at, "double-pendulum-from-bodies.toml", "bodies.toml", &[]);
    done(at, "simulate --rig bodies.toml --seconds 24 --seed 1 -o b.parquet");
    done(at, "identify b.parquet --rig bodies.toml -o bodies-model.toml");
    agrees(at, "bodies-model.toml", &[("phi1", "phi1"), ("phi2", "phi2")]);
    let identified = std::fs::read_to_string(at.join("bodies-model.toml")).unwrap();
    let quantities = "\n[found_with]\nJ_1 = 4.4e-4\nJ_2 = 4.033e-5\na_c = 0.0155\na_s = 0.0\ne1 = 0.0127\ne2 = 0.0267\ng = 9.81\nl1 = 0.0635\n\
        m1 = 0.1362\nm2 = 0.04\nrecord_s = 24.0\n";
    let effects = "\n[[effect]]\nid = \"quadratic-drag\"\nat = \"arm2\"\nvalue = 2e-7\nstd_error = 1e-9\nunit = \"N m s²\"\nstrengths = [2e-7]\nparameters = {}\n\
        [[effect]]\nid = \"stribeck-friction\"\nat = \"joint1\"\nvalue = 2e-4\nstd_error = 1e-6\nunit = \"N m\"\nstrengths = [2e-4]\nparameters = { v_s = 2.0 }\n";
    std::fs::write(at.join("explained.toml"), format!("{identified}{quantities}{effects}")).unwrap();
    agrees(at, "explained.toml", &[("phi1", "phi1"), ("phi2", "phi2")]);
}

#[test]
fn the_other_languages_are_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let golden = repository("tests/golden/export");
    for model in ["double-pendulum", "oscillator"] {
        std::fs::copy(golden.join(format!("{model}.toml")), folder.path().join(format!("{model}.toml"))).unwrap();
        for (language, extension) in
            [("julia", "jl"), ("modelica", "mo"), ("latex", "tex"), ("matlab", "m"), ("python", "py"), ("c", "c")]
        {
            let name = format!("{}.{extension}", model.replace('-', "_"));
            done(folder.path(), &format!("export {model}.toml --to {language} -o {name}"));
            let text = std::fs::read_to_string(folder.path().join(&name)).unwrap();
            if std::env::var_os("WHIRL_BLESS").is_some() {
                std::fs::write(golden.join(&name), &text).unwrap();
            }
            let wanted = std::fs::read_to_string(golden.join(&name)).unwrap_or_default();
            assert_eq!(text, wanted, "{name}: WHIRL_BLESS=1 accepts what has changed");
        }
    }
}

#[test]
fn what_cannot_leave_is_refused_with_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let shipped = std::fs::read_to_string(repository("tests/golden/export/double-pendulum.toml")).unwrap();
    let write = |name: &str, from: &str, to: &str| {
        assert!(shipped.contains(from), "{from}");
        std::fs::write(at.join(name), shipped.replace(from, to)).unwrap();
    };
    write("m.toml", "", "");
    write("rust.toml", "quadratic-drag", "rust");
    write(
        "load.toml",
        "id = \"viscous-friction\"\nat = \"joint1\"",
        "id = \"load-dependent-friction\"\nat = \"joint2\"",
    );
    write("missing.toml", "B21 = ", "B31 = ");
    let own = std::fs::read_to_string(repository("tests/golden/export/oscillator.toml")).unwrap();
    std::fs::write(at.join("bodies.toml"), format!("{own}\n[found_with]\nmass = 1.0\n")).unwrap();
    std::fs::write(
        at.join("more.toml"),
        own.replace(
            "{ name = \"x\", space = \"R\" }",
            "{ name = \"x\", space = \"R\" }, { name = \"y\", space = \"R\" }",
        ),
    )
    .unwrap();
    std::fs::write(at.join("r.csv"), "t,phi1,phi2\n0,0,0\n0.002,0,0\n").unwrap();
    let export = |model: &str| format!("export {model} --to python -o out.py");
    let simulate = |options: &str| format!("simulate --model m.toml -o out.csv {options}");
    for (arguments, told) in [
        (export("none.toml"), "none.toml"),
        (export("rust.toml"), "rust.toml: effect 1: found \"rust@arm2\""),
        (
            export("load.toml"),
            "load.toml: effect 2: found \"load-dependent-friction@joint2\", whose force depends on accelerations",
        ),
        (export("missing.toml"), "missing.toml: parameters.B31"),
        (export("bodies.toml"), "--rig RIG.toml"),
        (export("more.toml"), "1 equations for 2 coordinates"),
        ("export m.toml --to python -o m.toml".to_owned(), "a file that this command reads"),
        ("export m.toml --to python -o r.csv".to_owned(), "a record that is there already"),
        (simulate("--initial 1,2"), "--initial: found 1,2, expected 4 numbers: phi1, phi2, then their rates"),
        (simulate("--seconds 0"), "--seconds"),
        (simulate("--from r.csv"), "r.csv: --from: found a record without a rig file"),
    ] {
        let run = whirl(at, &arguments);
        assert_eq!((run.status, run.stdout.as_str()), (2, ""), "{arguments}: {run:?}");
        assert!(run.stderr.contains(told) && run.stderr.lines().count() == 1, "{arguments}: {}", run.stderr);
    }
    for usage in [
        "export m.toml --to basic -o out.bas",
        "simulate --model m.toml --start 1 -o o.csv",
        "simulate --seconds 1 -o o.csv",
    ] {
        assert_eq!(whirl(at, usage).status, 2, "{usage}");
    }
    assert!(!at.join("out.py").exists() && !at.join("out.csv").exists());
}
