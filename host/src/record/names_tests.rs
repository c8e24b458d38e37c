use super::*;

fn names(list: &[&str]) -> Vec<String> {
    list.iter().map(|n| (*n).to_owned()).collect()
}

fn time(list: &[&str]) -> Result<(usize, Option<f64>)> {
    time_column(&names(list), &TimeChoice::default(), Path::new("r.csv")).map(|c| (c.index, c.per_second))
}

#[test]
fn units_are_told_from_names() {
    for (name, base, text) in [
        ("theta1_deg", "theta1", "deg"),
        ("Winkel 1 (deg)", "Winkel 1", "deg"),
        ("Angle [rad]", "Angle", "rad"),
        ("x / mm", "x", "mm"),
        ("Time, s", "Time", "s"),
        ("x_mm", "x", "mm"),
        ("phi (°)", "phi", "°"),
        // Of a run or a sensor.
        ("Force (N) Run 8", "Force", "N"),
        ("Acceleration (m/s²) Run 8", "Acceleration", "m/s²"),
        ("Position [mm], left (2)", "Position", "mm"),
        ("(N) Force", "Force", "N"),
        ("Force(N) 2", "Force", "N"),
        ("Angle (deg) (furlong)", "Angle", "deg"),
        ("Angle (furlong)", "Angle", "furlong"),
        ("Pixel (X) [px]", "Pixel (X)", "px"),
        ("T_C", "T", "C"),
        ("Temperature C", "Temperature", "C"),
    ] {
        assert_eq!(split(name), (base.to_owned(), Some(text.to_owned())), "{name}");
    }
    for name in ["count1", "theta_1", "encoder", "phi2", "arm-2", "u", "x0", "x (1) left", "V_C", "u_K"] {
        assert_eq!(split(name).1, None, "{name}");
    }
    assert_eq!(unit("Degrees").unwrap(), NamedUnit { unit: Some("deg"), factor: 1.0 });
    assert_eq!(unit("cm").unwrap(), NamedUnit { unit: Some("m"), factor: 0.01 });
    assert_eq!(unit("rad/s").unwrap().unit, None);
    assert_eq!(unit("px").unwrap().unit, Some("1"));
    assert_eq!((unit("n"), unit("furlong")), (None, None));
}

#[test]
fn the_time_is_found_by_its_names() {
    assert_eq!(time(&["x", "t", "time"]).unwrap(), (1, None));
    assert_eq!(time(&["Time (s)", "Winkel 1 (deg)"]).unwrap(), (0, Some(1.0)));
    assert_eq!(time(&["a", "time_ms"]).unwrap(), (1, Some(1e3)));
    assert_eq!(time(&["a", "Timestamp"]).unwrap(), (1, None));
    assert_eq!(time(&["a", "Zeit [µs]"]).unwrap(), (1, Some(1e6)));
    assert_eq!(time(&["Time (s) Run 8", "Force (N) Run 8"]).unwrap(), (0, Some(1.0)));
    assert_eq!(time(&["theta", "__index_level_0__"]).unwrap(), (1, None));
    assert_eq!(time(&["run.x", "run.time_ms"]).unwrap(), (1, Some(1e3)));
    assert!(time(&["a.t", "b.t"]).unwrap_err().to_string().contains("--time \"a.t\""));
    let both = time(&["time", "timestamp", "x"]).unwrap_err().to_string();
    assert!(both.contains("\"time\" and \"timestamp\"") && both.contains("--time \"time\""), "{both}");
    assert_eq!(time(&["millis", "counts"]).unwrap(), (0, Some(1e3)));
    assert_eq!(time(&["millis", "time", "x"]).unwrap(), (1, None));
    assert!(time(&["min", "max"]).is_err() && time(&["s", "h"]).is_err());
    assert!(time(&["temperature", "x"]).is_err() && time(&["t", "t"]).is_err());
}

#[test]
fn a_choice_of_time_may_say_its_unit() {
    let choose = |column: &str, unit: Option<&str>| {
        let choice = TimeChoice { column: Some(column.into()), unit: unit.map(Into::into) };
        time_column(&names(&["clock", "a:ms", "x"]), &choice, Path::new("r.csv"))
    };
    assert_eq!(choose("clock", Some("ns")).unwrap().per_second, Some(1e9));
    assert_eq!(choose("clock:us", None).unwrap().per_second, Some(1e6));
    assert_eq!(choose("a:ms", None).unwrap().index, 1);
    assert_eq!(choose("Clock", None).unwrap().index, 0);
    assert!(choose("clock", Some("fortnight")).unwrap_err().to_string().contains("a unit of time: s, ms"));
    let missing = |column: &str| choose(column, None).unwrap_err().to_string();
    let close = missing("clok:ms");
    assert!(close.contains("Did you mean clock? Say --time \"clock:ms\", or time = \"clock:ms\""), "{close}");
    assert!(missing("Winkelzeit").contains("--time COLUMN, or time = \"COLUMN\" in the rig file"));
    let written = |column: Option<&str>, unit: Option<&str>| {
        let choice = TimeChoice { column: column.map(Into::into), unit: unit.map(Into::into) };
        let (name, per_second) = written_time(&choice);
        let read = time_column(&names(&["x", &name]), &choice, Path::new("r.csv")).unwrap();
        assert_eq!((read.index, read.per_second.unwrap_or(1.0)), (1, per_second), "{choice:?}");
        (name, per_second)
    };
    assert_eq!(written(None, None), ("t".to_owned(), 1.0));
    assert_eq!(written(None, Some("ms")), ("t".to_owned(), 1e3));
    assert_eq!(written(Some("t / us"), None), ("t / us".to_owned(), 1e6));
    assert_eq!(written(Some("clock:ms"), None), ("clock".to_owned(), 1e3));
    assert_eq!(written(Some("time"), Some("min")), ("time".to_owned(), 1.0 / 60.0));
}

#[test]
fn a_device_s_own_time_has_one_name() {
    let told = |asked| own_time(asked, Path::new("r.csv")).map_err(|e| e.to_string());
    assert!(told(None).is_ok() && told(Some("t")).is_ok());
    assert!(told(Some("nosuch")).is_err_and(|e| e.starts_with("r.csv: --time: found \"nosuch\", expected t,")));
}
