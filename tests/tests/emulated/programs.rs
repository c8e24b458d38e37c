//! The emulated board's other programs: the cases of `firmware/cases`, each in a fresh machine, and
//! the measurements.

use std::path::Path;
use std::process::Command;

use crate::image;

/// Runs a program; its console and whether it ended well.
fn run(program: &Path, argument: Option<usize>) -> (String, bool) {
    let mut semihosting = "enable=on,target=native".to_owned();
    if let Some(index) = argument {
        semihosting.push_str(&format!(",arg=cases,arg={index}"));
    }
    let output = Command::new("qemu-system-arm")
        .args(["-machine", "mps2-an386", "-display", "none", "-monitor", "none", "-nodefaults"])
        .args(["-semihosting-config", &semihosting, "-icount", "shift=5,sleep=off", "-kernel"])
        .arg(program)
        .output()
        .unwrap();
    let console = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    (console, output.status.success())
}

#[test]
fn the_cases_pass_on_the_target_too() {
    let Some(program) = image::binary("whirl-cases-mps2-an386") else { return };
    let (console, listed) = run(&program, None);
    let names: Vec<&str> = console.lines().filter_map(|line| line.strip_prefix("case ")).collect();
    assert!(listed && names.len() >= 11, "{console}");
    for (index, name) in names.iter().enumerate() {
        let (console, passed) = run(&program, Some(index));
        assert!(passed && console.contains(&format!("passed {name}")), "{name}: {console}");
    }
    // A case that is not there fails, so that a failure is not taken for a pass.
    let (console, passed) = run(&program, Some(names.len()));
    assert!(!passed && console.contains("no case"), "{console}");
}

#[test]
fn a_tick_is_within_its_instructions() {
    let Some(program) = image::binary("whirl-measure-mps2-an386") else { return };
    let (console, done) = run(&program, None);
    assert!(done, "{console}");
    println!("{console}");
    let most = |part: &str| -> u32 {
        let line =
            console.lines().find(|line| line.starts_with(part)).unwrap_or_else(|| panic!("no {part}: {console}"));
        line.split_once(" most ").unwrap().1.parse().unwrap()
    };
    // Every part's worst tick at once, in instructions. What follows the end of a window
    // is spread over samples.
    let parts =
        ["interrupt: sampling", "interrupt: what lasts", "stream: other", "thread: one command", "estimate: a sample"];
    // A block that is sent again waits until none was streamed for two turns of the thread.
    let block = most("stream: the frame of a block").max(most("stream: a block that is sent again"));
    let all = parts.into_iter().map(most).sum::<u32>() + block;
    println!("all worst cases in one tick: {all}");
    assert!(all <= 34_000, "{all}: {console}");
    // While that is no sine nothing is identified.
    let six = ["six sines: the interrupt", "six sines: a command", "interrupt: what lasts", "stream: other"];
    let six = six.into_iter().map(most).sum::<u32>() + block;
    println!("the same of six sines in a sweep: {six}");
    assert!(six <= 34_000, "{six}: {console}");
    let table = ["a table: the interrupt", "a table: a command", "interrupt: what lasts", "stream: other"];
    let table = table.into_iter().map(most).sum::<u32>() + block;
    println!("the same of a table: {table}");
    assert!(table <= 34_000, "{table}: {console}");
    // Its points cost no more than those of six sines.
    let mean = |part: &str| -> u32 {
        let line = console.lines().find(|line| line.starts_with(part)).unwrap();
        line.split_once(" mean ").unwrap().1.split(' ').next().unwrap().parse().unwrap()
    };
    assert!(mean("a table: the interrupt") <= mean("six sines: the interrupt"), "{console}");
    // And as it runs, the thread working on ten samples at a time.
    let ten = 10 * (most("interrupt: sampling") + most("interrupt: what lasts") + most("thread: one command"))
        + most("thread: all of a block");
    println!("ten ticks of the interrupt and a block of the thread, at worst: {ten}");
    assert!(ten <= 340_000, "{ten}: {console}");
}
