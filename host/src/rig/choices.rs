//! What options of a command say of a record's columns, beside the rig file: `--time COLUMN`,
//! `--map MEASURE=COLUMN`.

use std::path::Path;

use super::RigFile;
use crate::error::{BadInput, Result};

/// Choices of columns that go before what the rig file says.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Choices {
    /// The column of the time, with its unit behind a colon where it needs one (`clock:ms`).
    pub time: Option<String>,
    /// What is measured, and the column that shows it.
    pub map: Vec<(String, String)>,
}

impl Choices {
    /// Writes them into what was read of a rig file.
    pub(super) fn apply(&self, file: &mut RigFile, path: &Path) -> Result<()> {
        if let Some(time) = &self.time {
            if time.is_empty() {
                return Err(BadInput::new("an empty name", "the name of the time's column").at("--time"));
            }
            file.time = Some(time.clone());
            file.time_unit = None;
        }
        for (measure, column) in &self.map {
            let measures: Vec<String> = file.channel.iter().map(|c| c.measures.clone()).collect();
            let Some(channel) = file.channel.iter_mut().find(|c| c.measures == *measure) else {
                return Err(BadInput::new(format!("\"{measure}\""), format!("one of {}", measures.join(", ")))
                    .at("--map")
                    .remedy(format!("Name what a channel of {} measures", path.display())));
            };
            channel.name.clone_from(column);
        }
        Ok(())
    }
}

/// MEASURE=COLUMN.
///
/// # Errors
/// Says what was expected.
pub fn pair(text: &str) -> core::result::Result<(String, String), String> {
    match text.split_once('=') {
        Some((measure, column)) if !measure.trim().is_empty() && !column.is_empty() => {
            Ok((measure.trim().to_owned(), column.to_owned()))
        }
        _ => Err(format!("\"{text}\" is not MEASURE=COLUMN, such as theta1=\"Angle (deg)\"")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Rig;

    const RIG: &str = "name = \"x\"\nmodel = \"double-pendulum\"\ntime_unit = \"ms\"\n\
        [[channel]]\nname = \"count1\"\nmeasures = \"theta1\"\nunit = \"deg\"\n\
        [[channel]]\nname = \"count2\"\nmeasures = \"theta2\"\nunit = \"deg\"\n";

    fn read(choices: &Choices) -> Result<Rig> {
        Rig::of_text(RIG, Path::new("rig.toml"), choices, &mut |_| Ok(Some(500.0)))
    }

    #[test]
    fn choices_go_before_the_file() {
        let choices = Choices {
            time: Some("clock".into()),
            map: vec![pair("theta1=b").unwrap(), pair("theta2=count1").unwrap()],
        };
        let rig = read(&choices).unwrap();
        let names: Vec<&str> = rig.channel.iter().map(|c| c.name.as_str()).collect();
        assert_eq!((names, rig.sample_rate_hz), (vec!["b", "count1"], 500.0));
        assert_eq!((rig.time.column.as_deref(), rig.time.unit), (Some("clock"), None));
        assert_eq!(read(&Choices::default()).unwrap().time.unit.as_deref(), Some("ms"));
    }

    #[test]
    fn wrong_choices_are_told() {
        let map = |text: &str| Choices { time: None, map: vec![pair(text).unwrap()] };
        let message = read(&map("theta3=b")).unwrap_err().to_string();
        assert!(message.contains("--map: found \"theta3\", expected one of theta1, theta2"), "{message}");
        // Two channels of one column.
        assert!(read(&map("theta1=count2")).unwrap_err().to_string().contains("a second time"));
        for wrong in ["theta1", "=b", "theta1="] {
            assert!(pair(wrong).unwrap_err().contains("MEASURE=COLUMN"), "{wrong}");
        }
    }
}
