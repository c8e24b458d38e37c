//! Reports as a browser shows them: nothing is fetched, nothing fails, figures and tables stay
//! within the page, on a desk and on a phone.

use std::path::Path;
use std::process::Command;

use super::program::{done, whirl};
use whirl_tests::repository;

/// Names of the browser in the system's packages.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// The browser; none where there is none.
fn browser() -> Option<&'static str> {
    BROWSERS.into_iter().find(|b| Command::new(b).arg("--version").output().is_ok_and(|o| o.status.success()))
}

/// Measures a page in a frame of a width: what sticks out of it, and the smallest letters of a
/// figure, CSS pixels.
const MEASURE: &str = r#"
function measure(frame) {
  const d = frame.contentDocument, wide = d.documentElement.clientWidth, out = [];
  if (d.documentElement.scrollWidth > wide) out.push('page is ' + d.documentElement.scrollWidth + ' wide');
  for (const e of d.querySelectorAll('figure, .scroll, p, h1, h2, h3, .warning')) {
    const r = e.getBoundingClientRect();
    if (r.right > wide + 1 || r.left < -1) out.push(e.tagName + ' at ' + r.left + ' … ' + r.right);
  }
  let letters = 100, drawn = 0;
  for (const svg of d.querySelectorAll('figure svg')) {
    const r = svg.getBoundingClientRect();
    if (r.width === 0) continue;
    drawn += 1;
    const plot = svg.parentElement, scrolls = getComputedStyle(plot).overflowX === 'auto';
    if (!scrolls && r.right > plot.getBoundingClientRect().right + 1) out.push('a drawing leaves its box');
    const scale = r.width / svg.viewBox.baseVal.width;
    for (const t of svg.querySelectorAll('text')) {
      const b = t.getBoundingClientRect();
      letters = Math.min(letters, scale * parseFloat(t.getAttribute('font-size')));
      if (b.left < r.left - 2 || b.right > r.right + 2 || b.top < r.top - 2 || b.bottom > r.bottom + 2)
        out.push('"' + t.textContent + '" leaves its drawing by ' + [r.left - b.left, b.right - r.right].map(Math.round));
    }
  }
  return JSON.stringify({ width: wide, drawn, letters, out, used: used(d), links: d.querySelectorAll('a[download$=".svg"]').length });
}
// Uses the first figure as a mouse would: what is read out, what is shown after a rectangle was
// drawn, and after a double click.
function used(d) {
  const svg = [...d.querySelectorAll('figure svg[data-panels]')].find(s => s.getBoundingClientRect().width > 0);
  const r = svg.getBoundingClientRect(), whole = svg.getAttribute('viewBox');
  const [l, t, w, h] = svg.dataset.panels.split(';')[0].split(' ').map(Number), scale = r.width / svg.viewBox.baseVal.width;
  const send = (kind, x, y) => svg.dispatchEvent(new d.defaultView.PointerEvent(kind,
    { clientX: r.left + scale * (l + x * w), clientY: r.top + scale * (t + y * h), pointerType: 'mouse', button: 0, bubbles: true }));
  const seen = [];
  send('pointermove', 0.5, 0.5);
  seen.push(svg.nextElementSibling?.textContent ?? '');
  send('pointerdown', 0.25, 0.25);
  send('pointermove', 0.75, 0.75);
  send('pointerup', 0.75, 0.75);
  seen.push(svg.getAttribute('viewBox') !== whole);
  svg.dispatchEvent(new d.defaultView.MouseEvent('dblclick'));
  seen.push(svg.getAttribute('viewBox') === whole);
  return seen;
}
addEventListener('load', () => {
  document.getElementById('found').textContent = [...document.querySelectorAll('iframe')].map(measure).join('\n');
});
"#;

/// What a browser finds in a page at two widths, and what it logs.
fn seen(browser: &str, folder: &Path, page: &str) -> (Vec<serde_json::Value>, String) {
    let escaped = page.replace('&', "&amp;").replace('"', "&quot;");
    let frame = |width: u32, of: &str| {
        format!("<iframe {of} width={width} height=900 style=\"border:0\" srcdoc=\"{escaped}\"></iframe>")
    };
    let host = format!(
        "<!DOCTYPE html><meta charset=utf-8><pre id=found></pre>{}{}<script>{MEASURE}</script>",
        frame(1280, ""),
        frame(390, "") + &frame(1280, "sandbox=allow-same-origin")
    );
    let file = folder.join("host.html");
    std::fs::write(&file, host).unwrap();
    let log = folder.join("net.json");
    let run = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-background-networking",
            "--enable-logging=stderr",
        ])
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .arg(format!("--log-net-log={}", log.display()))
        .args(["--virtual-time-budget=20000", "--dump-dom"])
        .arg(format!("file://{}", file.display()))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&run.stdout);
    let found = text
        .split_once("<pre id=\"found\">")
        .and_then(|(_, rest)| rest.split_once("</pre>"))
        .expect("the page loads")
        .0;
    let found = found.replace("&quot;", "\"").replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    let found = found.lines().map(|l| serde_json::from_str(l).unwrap_or_else(|e| panic!("{e}: {l}"))).collect();
    (found, String::from_utf8_lossy(&run.stderr).into_owned())
}

#[test]
fn a_browser_shows_reports_whole_and_fetches_nothing() {
    let Some(browser) = browser() else {
        eprintln!("no browser ({}): reports are not looked at", BROWSERS.join(", "));
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let rig = repository("rigs/chaotic.toml");
    let rig = rig.display();
    done(here, &format!("simulate --rig {rig} --effect quadratic-drag@arm2=2e-7 --seconds 60 --seed 1 -o r.parquet"));
    done(here, &format!("explain r.parquet --rig {rig} --report explain.html -o m.toml"));
    // The drag is missing from what `identify` fits: its answer may be negative.
    assert!(whirl(here, &format!("identify r.parquet --rig {rig} --report identify.html")).status < 2);
    for name in ["explain.html", "identify.html"] {
        let page = std::fs::read_to_string(here.join(name)).unwrap();
        let (found, log) = seen(browser, here, &page);
        assert_eq!(found.len(), 3, "{name}: {log}");
        for (view, (width, script)) in found.iter().zip([(1280, true), (390, true), (1280, false)]) {
            let read = view["used"][0].as_str().unwrap();
            assert_eq!(read.contains("across ") && read.contains("up "), script, "{name}: {view}");
            assert_eq!((&view["used"][1], &view["used"][2]), (&script.into(), &true.into()), "{name}: {view}");
            assert_eq!(view["links"].as_u64().unwrap() >= 2, script, "{name}: {view}");
            assert!(view["width"].as_u64().unwrap().abs_diff(width) <= 20, "{name}: {view}");
            assert!(view["drawn"].as_u64().unwrap() >= 2, "{name}: {view}");
            assert_eq!(view["out"], serde_json::json!([]), "{name} at {width} px: {view}");
            assert!(view["letters"].as_f64().unwrap() > 8.0, "{name} at {width} px: {view}");
        }
        // What the sandbox of the last frame says of the script that it does not run is no error of
        // the page.
        let said: Vec<&str> = log.lines().filter(|l| l.contains("CONSOLE") && !l.contains("sandboxed")).collect();
        assert!(said.is_empty(), "{name}: {said:?}");
        let net = std::fs::read_to_string(here.join("net.json")).unwrap();
        let fetched: Vec<&str> = net.split("\"url\":\"").skip(1).filter_map(|u| u.split('"').next()).collect();
        let strange: Vec<&&str> = fetched.iter().filter(|u| u.starts_with("http") && page.contains(**u)).collect();
        assert!(strange.is_empty(), "{name} fetches {strange:?}");
        assert_eq!(page.matches("<script").count(), 1, "{name}: one script, its own");
        for fetches in ["<script ", "<link", "src=", "url(", "@import", "http-equiv"] {
            assert!(!page.contains(fetches), "{name} holds {fetches}");
        }
    }
}
