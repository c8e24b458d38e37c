//! A model that leaves: a record of the shipped rig, its identified model as a file, and that model
//! as Python and C.
//!
//! `cargo run --release -p whirl-cli --example model_as_code`

use std::ffi::OsString;
use std::path::Path;

use whirl::api::{self, Error};

fn call(folder: &Path, words: &str) -> Result<String, Error> {
    let words = words.replace("FOLDER", &folder.display().to_string());
    let words: Vec<OsString> = words.split_whitespace().map(OsString::from).collect();
    Ok(api::call(&words)?.said.text)
}

fn run(folder: &Path) -> Result<[String; 2], Box<dyn std::error::Error>> {
    let rig = Path::new(env!("CARGO_MANIFEST_DIR")).join("../rigs/seed.toml");
    let rig = rig.display();
    call(folder, &format!("simulate --rig {rig} --seconds 24 --seed 1 -o FOLDER/run.parquet"))?;
    call(folder, &format!("identify FOLDER/run.parquet --rig {rig} --method weak -o FOLDER/model.toml"))?;
    for language in ["python -o FOLDER/model.py", "c -o FOLDER/model.c"] {
        println!("{}", call(folder, &format!("export FOLDER/model.toml --to {language}"))?);
    }
    Ok([std::fs::read_to_string(folder.join("model.py"))?, std::fs::read_to_string(folder.join("model.c"))?])
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::temp_dir().join(format!("whirl-example-code-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let code = run(&folder);
    let _ = std::fs::remove_dir_all(&folder);
    let [python, c] = code?;
    println!("{} lines of Python, {} of C", python.lines().count(), c.lines().count());
    Ok(())
}

#[cfg(test)]
mod tests {
    #[test]
    fn it_writes_code() {
        let folder = tempfile::tempdir().unwrap();
        let [python, c] = super::run(folder.path()).unwrap();
        assert!(python.contains("B21") && c.contains("#include <math.h>"), "{python}{c}");
    }
}
