//! What a command is going to read and write, checked before anything runs: no output is an input
//! or another output, none replaces a record unasked, and every output's folder can be written to.

use std::path::{Path, PathBuf};

use super::output::{Output, Replace};
use crate::error::{BadInput, Result};
use crate::files;
use crate::record::formats;
use crate::rig::Rig;

/// What an output holds, which decides what it may replace without `--force`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Measured or simulated samples: replaces nothing.
    Record,
    /// A result: replaces results, no record, no rig file.
    Result,
    /// A table of results: as a result, whatever its extension.
    Table,
    /// Made again from what it was made of, or kept safe by what writes it.
    Again,
}

/// An output that was asked for.
struct Planned {
    option: &'static str,
    kind: Kind,
    path: PathBuf,
}

/// The files of a command.
#[derive(Default)]
pub struct Outputs {
    /// Whether recorded files may be replaced; none where the command has no option for it.
    force: Option<bool>,
    inputs: Vec<PathBuf>,
    planned: Vec<Planned>,
}

impl Outputs {
    /// `--json`, `--report` and, where a command has it, `--force`.
    pub fn of(out: &Output, replace: Option<Replace>) -> Self {
        let mut files = Self { force: replace.map(|r| r.force), ..Self::default() };
        if out.json.as_ref().is_some_and(|p| p.as_os_str() != "-") {
            files = files.result("--json", out.json.as_ref());
        }
        files.result("--report", out.report.as_ref())
    }

    /// Files that are read.
    pub fn reads<P: AsRef<Path>>(mut self, paths: impl IntoIterator<Item = P>) -> Self {
        self.inputs.extend(paths.into_iter().map(|p| p.as_ref().to_path_buf()));
        self
    }

    /// A rig file, and the model file that it names.
    pub fn reads_rig(self, rig: &Rig) -> Self {
        let model = rig.bound.as_ref().map(|b| b.model.source.path.clone());
        self.reads([rig.path.clone()]).reads(model)
    }

    /// A record that is written.
    pub fn record(self, option: &'static str, path: &Path) -> Self {
        self.add(option, Kind::Record, Some(path))
    }

    /// A result that is written, if it is asked for.
    pub fn result<P: AsRef<Path>>(self, option: &'static str, path: Option<P>) -> Self {
        self.add(option, Kind::Result, path)
    }

    /// A table of results that is written, if it is asked for.
    pub fn table<P: AsRef<Path>>(self, option: &'static str, path: Option<P>) -> Self {
        self.add(option, Kind::Table, path)
    }

    /// A file that is made again from what it was made of, or that its writer does not replace.
    pub fn again(self, option: &'static str, path: &Path) -> Self {
        self.add(option, Kind::Again, Some(path))
    }

    /// A table of many records: replaces one of its kind, and nothing else unasked.
    pub fn table_of_rows(self, option: &'static str, path: &Path) -> Self {
        let kind = if crate::batch::table::Table::is_at(path) { Kind::Again } else { Kind::Result };
        self.add(option, kind, Some(path))
    }

    /// The same with the journal beside it, whose writer knows what it replaces.
    pub fn batch(self, option: &'static str, path: &Path) -> Self {
        self.table_of_rows(option, path).again(option, &crate::batch::journal::path_of(path))
    }

    fn add<P: AsRef<Path>>(mut self, option: &'static str, kind: Kind, path: Option<P>) -> Self {
        self.planned.extend(path.map(|p| Planned { option, kind, path: p.as_ref().to_path_buf() }));
        self
    }

    /// Checks them all.
    ///
    /// # Errors
    /// Names the option, what its file is, and what to do.
    pub fn check(&self) -> Result<()> {
        for (i, output) in self.planned.iter().enumerate() {
            let Planned { option, kind, path } = output;
            let bad = |found: &str, expected: &str, remedy: &str| {
                Err(BadInput::new(found, expected).in_file(path).at(*option).remedy(remedy))
            };
            if path.is_dir() {
                return bad("a folder", "a file", "Name a file inside of it");
            }
            if path.as_os_str() == "-" || path.file_name().is_none() {
                let found = if path.as_os_str() == "-" { "-" } else { "no file name" };
                return bad(found, "a file", "Name a file; `-` is standard output for --json alone");
            }
            if self.inputs.iter().any(|input| files::same(input, path)) {
                return bad("a file that this command reads", "another file", "Name another output");
            }
            if files::is_special(path) {
                continue;
            }
            if let Some(other) = self.planned[..i].iter().find(|o| files::same(&o.path, path)) {
                return bad(&format!("the file of {}", other.option), "a file of its own", "Name another output");
            }
            if let Some(what) = replaced(*kind, path).filter(|_| self.force != Some(true)) {
                let found = format!("{what} that is there already");
                let remedy = match self.force {
                    Some(_) => "Name another output, or replace it with --force",
                    None => "Name another output",
                };
                return bad(&found, "a new file", remedy);
            }
            writable(path, option)?;
        }
        Ok(())
    }
}

/// What would be lost if an output of this kind were written; none where nothing would.
fn replaced(kind: Kind, path: &Path) -> Option<&'static str> {
    let there = std::fs::metadata(path).is_ok_and(|m| m.len() > 0);
    match kind {
        _ if !there => None,
        Kind::Again => None,
        Kind::Record => Some(formats::recorded(path).unwrap_or("a file")),
        Kind::Result => formats::recorded(path).or_else(|| formats::is_named_as_record(path).then_some("a record")),
        Kind::Table => formats::recorded(path),
    }
}

/// Tries whether a file can be written beside `path`, and `path` itself where it is there.
fn writable(path: &Path, option: &'static str) -> Result<()> {
    let fail = |e: std::io::Error| {
        BadInput::io(path, &e).at(option).remedy("Name an output file in a folder that exists and can be written")
    };
    let target = files::resolve(path)
        .ok_or_else(|| fail(std::io::Error::new(std::io::ErrorKind::NotFound, "its folder does not exist")))?;
    if target.exists() {
        std::fs::OpenOptions::new().write(true).open(&target).map_err(fail)?;
    }
    let trial = target.with_file_name(format!(".whirl-{}.trial", std::process::id()));
    std::fs::OpenOptions::new().write(true).create_new(true).open(&trial).map_err(fail)?;
    std::fs::remove_file(&trial).map_err(fail)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = "sample_rate_hz = 500.0\n[[channel]]\nname = \"x\"\n";

    #[test]
    fn what_would_be_lost_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (name, text) in [
            ("r.csv", "t,x\n0,1\n"),
            ("curve.csv", "curve,frequency_hz\nfree,1\n"),
            ("hidden.json", "PAR1\0\0"),
            ("rig.toml", RIG),
            ("model.toml", "name = \"m\"\nmethod = \"weak\"\n"),
            ("result.json", "{}\n"),
            ("page.html", "<!doctype html>\n"),
            ("empty.parquet", ""),
        ] {
            std::fs::write(at(name), text).unwrap();
        }
        let refused = |kind: Kind, name: &str| {
            Outputs { force: Some(false), ..Outputs::default() }
                .add("-o", kind, Some(at(name)))
                .check()
                .err()
                .map(|e| e.to_string())
        };
        for name in ["r.csv", "curve.csv", "hidden.json", "rig.toml", "result.json"] {
            assert!(refused(Kind::Record, name).is_some_and(|e| e.contains("--force")), "{name}");
            assert!(Outputs { force: Some(true), ..Outputs::default() }.record("-o", &at(name)).check().is_ok());
        }
        for name in ["r.csv", "curve.csv", "hidden.json", "rig.toml"] {
            assert!(refused(Kind::Result, name).is_some_and(|e| e.contains("--force")), "{name}");
        }
        for name in ["model.toml", "result.json", "page.html", "empty.parquet", "new.json"] {
            assert_eq!(refused(Kind::Result, name), None, "{name}");
        }
        assert_eq!((refused(Kind::Table, "curve.csv"), refused(Kind::Table, "r.csv").is_some()), (None, true));
        // The trial leaves nothing behind.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 8);
    }

    #[test]
    fn outputs_are_neither_inputs_nor_each_other_nor_nowhere() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("in.parquet"), "x").unwrap();
        let told = |files: Outputs| files.check().unwrap_err().to_string();
        let of = |name: &str| Outputs { force: Some(true), ..Outputs::default() }.result("--json", Some(at(name)));
        assert!(told(of("in.parquet").reads([at("./in.parquet")])).contains("that this command reads"));
        assert!(
            told(of("a.json").result("--report", Some(at("./a.json")))).contains("--report: found the file of --json")
        );
        assert!(told(of("")).contains("a folder") && told(of("none/a.json")).contains("its folder does not exist"));
        for name in ["-", "/", "..", ""] {
            assert!(Outputs::default().result("--report", Some(name)).check().is_err(), "{name:?}");
        }
        #[cfg(unix)]
        assert!(
            Outputs::default().result("--json", Some("/dev/null")).table("--curves", Some("/dev/null")).check().is_ok()
        );
    }
}
