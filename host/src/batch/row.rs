//! A record's row, and which columns a table has.
//!
//! A column's kind follows from its name alone, and which columns there are from the cells that
//! rows have: so a table that was read again, or merged, is laid out as the one that was computed.

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Text.
    Text,
    /// Whole numbers.
    Integer,
    /// Numbers.
    Number,
}
use Kind::{Integer, Number, Text};

/// A cell; one without a value is none at all.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Text, not empty.
    Text(String),
    /// A whole number.
    Integer(i64),
    /// A finite number.
    Number(f64),
}

/// Columns, by name.
type Columns = &'static [(&'static str, Kind)];

/// Columns before a command's own.
const FIRST: Columns = &[
    ("format", Integer),
    ("command", Text),
    ("run", Text),
    ("index", Integer),
    ("of", Integer),
    ("file", Text),
    ("hash", Text),
    ("seconds", Number),
    ("exit_status", Integer),
    ("verdict", Text),
    ("error", Text),
    ("warnings", Text),
    ("samples", Integer),
    ("lost", Integer),
    ("segments", Integer),
];
/// Columns of each command between those and the parameters.
const OWN: &[(&str, Columns)] = &[
    (
        "identify",
        &[
            ("model", Text),
            ("method", Text),
            ("not_by_shooting", Text),
            ("equations_used", Integer),
            ("equations_dropped", Integer),
            ("identification_error", Number),
            ("groups_not_separable", Text),
        ],
    ),
    (
        "explain",
        &[
            ("reason", Text),
            ("effects", Text),
            ("decided_by", Text),
            ("decided_by_value", Number),
            ("decided_by_limit", Number),
            ("gap_unit", Text),
            ("gap_horizon_s", Number),
            ("gap_before", Number),
            ("gap_after", Number),
            ("residual_power_before", Number),
            ("residual_power_after", Number),
        ],
    ),
    (
        "validate",
        &[
            ("model", Text),
            ("method", Text),
            ("checks_passed", Text),
            ("checks_failed", Text),
            ("simulated_s", Number),
            ("horizon_measured_s", Number),
            ("horizon_simulated_s", Number),
            ("section_p_value", Number),
            ("lyapunov_model", Number),
            ("lyapunov_model_std_error", Number),
            ("lyapunov_measured", Number),
            ("lyapunov_measured_std_error", Number),
            ("lyapunov_simulated", Number),
            ("lyapunov_simulated_std_error", Number),
            ("correlation_dimension_measured", Number),
            ("correlation_dimension_measured_std_error", Number),
            ("correlation_dimension_simulated", Number),
            ("correlation_dimension_simulated_std_error", Number),
        ],
    ),
];
/// What an effect's columns end with, behind `effectN_`.
const OF_EFFECT: Columns = &[
    ("id", Text),
    ("at", Text),
    ("value", Number),
    ("std_error", Number),
    ("unit", Text),
    ("parameters", Text),
    ("indistinguishable_from", Text),
];
/// Behind everything else.
const UNITS: &str = "units";
/// Seconds of work; only where they were asked for.
pub const WALL: &str = "wall_s";
const ERROR: &str = "_std_error";

/// The commands that have rows.
pub fn commands() -> impl Iterator<Item = &'static str> {
    OWN.iter().map(|(command, _)| *command)
}

/// The command whose columns these are.
pub fn command_of(columns: &[String]) -> Option<&'static str> {
    let has = |wanted: Columns| wanted.iter().all(|(name, _)| columns.iter().any(|c| c == name));
    OWN.iter().find(|(_, own)| has(FIRST) && has(own)).map(|(command, _)| *command)
}

/// Number of an effect and the rest of its column's name.
fn of_effect(column: &str) -> Option<(usize, &'static str, Kind)> {
    let (number, rest) = column.strip_prefix("effect")?.split_once('_')?;
    let (name, kind) = OF_EFFECT.iter().find(|(name, _)| *name == rest)?;
    Some((number.parse().ok().filter(|n| *n > 0 && *n < 1000)?, name, *kind))
}

/// The kind of a column that is no parameter's.
fn reserved(column: &str) -> Option<Kind> {
    let listed = OWN.iter().flat_map(|(_, own)| *own).chain(FIRST).find(|(name, _)| *name == column);
    match column {
        UNITS => Some(Text),
        WALL => Some(Number),
        _ => listed.map(|(_, kind)| *kind).or_else(|| of_effect(column).map(|(_, _, kind)| kind)),
    }
}

/// The kind of a column.
pub fn kind(column: &str) -> Kind {
    reserved(column).unwrap_or(Number)
}

/// The column of a parameter: its name, unless that would be another column's.
pub fn of_parameter(name: &str) -> String {
    let taken = reserved(name).is_some() || reserved(&format!("{name}{ERROR}")).is_some();
    match (taken, name.ends_with(ERROR)) {
        (true, _) => format!("parameter_{name}"),
        (false, true) => format!("{name}_value"),
        (false, false) => name.to_owned(),
    }
}

impl Cell {
    /// As CSV and journal hold it: numbers with the fewest digits that give back the same bits.
    pub fn written(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Integer(n) => n.to_string(),
            Self::Number(x) => format!("{x:?}"),
        }
    }

    /// Of a kind from its text; none where the text is not of that kind, or empty.
    pub fn read(kind: Kind, text: &str) -> Option<Self> {
        match kind {
            Text => (!text.is_empty()).then(|| Self::Text(text.to_owned())),
            Integer => text.parse().ok().map(Self::Integer),
            Number => text.parse().ok().filter(|x: &f64| x.is_finite()).map(Self::Number),
        }
    }
}

/// A record's cells by column; none is there twice.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row(pub Vec<(String, Cell)>);

impl Row {
    /// Sets a cell.
    pub fn set(&mut self, column: &str, cell: Cell) {
        match self.0.iter_mut().find(|(name, _)| name == column) {
            Some((_, there)) => *there = cell,
            None => self.0.push((column.to_owned(), cell)),
        }
    }

    /// Sets a text, unless it is empty.
    pub fn text(&mut self, column: &str, text: impl Into<String>) {
        let text = text.into();
        if !text.is_empty() {
            self.set(column, Cell::Text(text));
        }
    }

    /// Sets a number, unless it is none.
    pub fn number(&mut self, column: &str, value: f64) {
        if value.is_finite() {
            self.set(column, Cell::Number(value));
        }
    }

    /// Sets a whole number.
    pub fn integer(&mut self, column: &str, value: impl TryInto<i64>) {
        self.set(column, Cell::Integer(value.try_into().unwrap_or(i64::MAX)));
    }

    /// A cell.
    pub fn get(&self, column: &str) -> Option<&Cell> {
        self.0.iter().find(|(name, _)| name == column).map(|(_, cell)| cell)
    }

    /// A text; empty where there is none.
    pub fn text_of(&self, column: &str) -> &str {
        if let Some(Cell::Text(text)) = self.get(column) { text } else { "" }
    }

    /// A whole number; 0 where there is none.
    pub fn integer_of(&self, column: &str) -> i64 {
        if let Some(Cell::Integer(n)) = self.get(column) { *n } else { 0 }
    }
}

/// The columns of a table: fixed ones, parameters with their errors as they come up, as many
/// effects as the most that were found, units, and seconds of work where there are any.
pub fn columns(command: &str, rows: &[Row]) -> Vec<String> {
    let own = OWN.iter().find(|(name, _)| *name == command).map_or(&[][..], |(_, own)| own);
    let mut out: Vec<String> = FIRST.iter().chain(own).map(|(name, _)| (*name).to_owned()).collect();
    let (mut parameters, mut effects): (Vec<&str>, usize) = (Vec::new(), 0);
    for (name, _) in rows.iter().flat_map(|row| &row.0) {
        if let Some((number, _, _)) = of_effect(name) {
            effects = effects.max(number);
        } else if reserved(name).is_none() {
            let base = name.strip_suffix(ERROR).unwrap_or(name);
            if !parameters.contains(&base) {
                parameters.push(base);
            }
        }
    }
    out.extend(parameters.iter().flat_map(|name| [(*name).to_owned(), format!("{name}{ERROR}")]));
    out.extend((1..=effects).flat_map(|i| OF_EFFECT.iter().map(move |(rest, _)| format!("effect{i}_{rest}"))));
    out.push(UNITS.to_owned());
    if rows.iter().any(|row| row.get(WALL).is_some()) {
        out.push(WALL.to_owned());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(names: &[&str]) -> Row {
        Row(names.iter().map(|n| ((*n).to_owned(), Cell::Number(1.0))).collect())
    }

    #[test]
    fn columns_follow_from_the_cells_in_the_order_of_rows() {
        let rows = [row(&["B11", "C2_std_error"]), row(&["A", "B11", "effect2_value"]), row(&[])];
        let all = columns("explain", &rows);
        let at = all.iter().position(|c| c == "B11").unwrap();
        assert_eq!(all[at..at + 6], ["B11", "B11_std_error", "C2", "C2_std_error", "A", "A_std_error"]);
        assert_eq!((all[at + 6].as_str(), all.len()), ("effect1_id", at + 6 + 2 * OF_EFFECT.len() + 1));
        assert_eq!(command_of(&all), Some("explain"));
        assert_eq!(command_of(&columns("identify", &[])), Some("identify"));
        assert_eq!(columns("identify", &[row(&[WALL])]).last().unwrap(), WALL);
    }

    #[test]
    fn a_parameter_never_takes_another_column() {
        for (name, wanted) in [
            ("B11", "B11"),
            ("lost", "parameter_lost"),
            ("effect1_value", "parameter_effect1_value"),
            ("units", "parameter_units"),
            ("lyapunov_model", "parameter_lyapunov_model"),
            ("k_std_error", "k_std_error_value"),
        ] {
            assert_eq!(of_parameter(name), wanted);
        }
        assert_eq!((kind("B11"), kind("effect12_unit"), kind("lost")), (Number, Text, Integer));
    }

    #[test]
    fn numbers_are_read_as_they_were_to_the_bit() {
        for x in [0.1, -1.0 / 3.0, 1e-300, 5e-324, 1.797_693_134_862_315_7e308, -0.0, 3.0] {
            let cell = Cell::Number(x);
            let Some(Cell::Number(y)) = Cell::read(Number, &cell.written()) else { panic!("{x}") };
            assert_eq!(x.to_bits(), y.to_bits());
        }
        assert_eq!((Cell::read(Number, "NaN"), Cell::read(Text, ""), Cell::read(Integer, "1.5")), (None, None, None));
        let mut row = Row::default();
        row.number("a", f64::NAN);
        row.text("b", "");
        assert_eq!(row, Row::default());
        row.integer("c", 3_usize);
        row.integer("c", 4_usize);
        assert_eq!((row.0.len(), row.integer_of("c"), row.text_of("b")), (1, 4, ""));
    }
}
