//! Makes the pictures of `docs/gallery.md`: a record of each rig in it, simulated, and the phase
//! portraits of its inspection.
//!
//! `cargo run --release -p whirl-tests --example gallery`

use std::ffi::OsString;
use std::path::Path;

use whirl::api;
use whirl_tests::repository;

/// Rigs of the gallery, and how long a record is simulated, s.
const RIGS: [(&str, u32); 8] = [
    ("chaotic", 40),
    ("seed", 40),
    ("single-pendulum", 40),
    ("rotary-pendulum", 30),
    ("cart-pendulum", 30),
    ("measured-triple-pendulum", 20),
    ("duffing", 20),
    ("van-der-pol", 30),
];

fn call(words: &[&str]) -> Result<(), api::Error> {
    let words: Vec<OsString> = words.iter().map(OsString::from).collect();
    api::call(&words).map(drop)
}

/// The first drawing of a page's section.
fn drawing(page: &str, section: &str) -> Option<String> {
    let from = &page[page.find(&format!("<section id=\"{section}\">"))?..];
    let from = &from[from.find("<svg ")?..];
    let svg = &from[..from.find("</svg>")? + 6];
    // On a page of its own it has no style of a report around it, and no ground: on a dark page its
    // writing would not be seen.
    let plain = "<svg font-family=\"sans-serif\" ";
    let svg = svg.replacen("<svg class=wide ", plain, 1).replacen("<svg class=scrolls ", plain, 1);
    Some(svg.replacen('>', ">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>", 1))
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let into = repository("docs/gallery");
    std::fs::create_dir_all(&into)?;
    for (name, seconds) in RIGS {
        let rig = repository("rigs").join(format!("{name}.toml"));
        let (record, page) = (folder.path().join(format!("{name}.csv")), folder.path().join(format!("{name}.html")));
        let [rig, record, page]: [&str; 3] =
            [&rig, &record, &page].map(|p: &std::path::PathBuf| p.to_str().unwrap_or_default());
        call(&["simulate", "--rig", rig, "--seconds", &seconds.to_string(), "--seed", "1", "-o", record])?;
        call(&["inspect", record, "--rig", rig, "--report", page])?;
        let svg = drawing(&std::fs::read_to_string(Path::new(page))?, "portraits").ok_or("a page without portraits")?;
        println!("{name}: {} kB", svg.len() / 1000);
        std::fs::write(into.join(format!("{name}.svg")), svg + "\n")?;
    }
    Ok(())
}
