//! The seed's tables and figures: printed, reproduced, true, side by side. One file a chapter, one
//! line an item in [`ITEMS`].

pub mod accuracy;
pub mod chapter2;
pub mod chapter3;
pub mod chapter3_figures;
mod chapter3_frequencies;
mod chapter3_orbits;
pub mod chapter4;
pub mod chapter5;
pub mod chapter5_accuracy;
pub mod chapter5_beyond;
pub mod chapter5_figures;
mod chapter5_histories;
mod data;
mod drawing;
pub mod small_terms;

use serde::Serialize;

use crate::error::{BadInput, Result};
use crate::report::figures::canvas::Panel;
use crate::report::figures::scatter::scatter;
use crate::report::html::{Align, Html};
use crate::wording::format::significant;

/// A table or figure that can be reproduced.
pub struct Item {
    /// Id, such as `table-5.1`.
    pub id: &'static str,
    /// What it shows.
    pub about: &'static str,
    /// Reproduces it.
    pub run: fn() -> Result<Reproduction>,
}

/// Every item, in the seed's order.
pub static ITEMS: &[&[Item]] = &[
    chapter2::ITEMS,
    chapter3::ITEMS,
    chapter3_figures::ITEMS,
    chapter4::ITEMS,
    chapter5::ITEMS,
    chapter5_figures::ITEMS,
    chapter5_beyond::ITEMS,
    chapter5_accuracy::ITEMS,
    small_terms::ITEMS,
    accuracy::ITEMS,
];

/// All items.
pub fn items() -> impl Iterator<Item = &'static Item> {
    ITEMS.iter().flat_map(|chapter| chapter.iter())
}

/// The item with this id.
///
/// # Errors
/// An id that is not there.
pub fn by_id(id: &str) -> Result<&'static Item> {
    items().find(|i| i.id == id).ok_or_else(|| {
        BadInput::new(format!("\"{id}\""), "a table or figure").at("ID").remedy("`whirl reproduce --list` shows them")
    })
}

/// One line of a reproduction.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// What it is.
    pub quantity: String,
    /// The value printed in the seed.
    pub printed: Option<f64>,
    /// The value that the seed's own method gives here.
    pub reproduced: Option<f64>,
    /// The true value.
    #[serde(rename = "true")]
    pub truth: Option<f64>,
    /// What this product's own method gives, where it has another.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ours: Option<f64>,
    /// Unit; empty for none.
    pub unit: &'static str,
}

impl Row {
    /// A line.
    pub fn new(
        quantity: impl Into<String>,
        unit: &'static str,
        printed: Option<f64>,
        reproduced: Option<f64>,
        truth: Option<f64>,
    ) -> Self {
        Self { quantity: quantity.into(), printed, reproduced, truth, ours: None, unit }
    }

    /// With the value of this product's own method.
    pub fn ours(mut self, value: Option<f64>) -> Self {
        self.ours = value;
        self
    }
}

/// A reproduced table or figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reproduction {
    /// Id.
    pub id: String,
    /// What it shows.
    pub title: String,
    /// Numbers.
    pub rows: Vec<Row>,
    /// What to know when comparing.
    pub notes: Vec<String>,
    /// Drawing: panels, so many side by side, so high in CSS pixels.
    #[serde(skip)]
    pub panels: (Vec<Panel>, usize, f64),
}

/// A number of a table; a whole one, as a count is, without places.
fn cell(x: Option<f64>) -> String {
    let one = |x: f64| if x.fract() == 0.0 && x.abs() < 1e6 { format!("{x}") } else { significant(x, 5) };
    x.map_or_else(|| "–".to_owned(), one)
}

impl Reproduction {
    /// What the column of this product's own method is called.
    fn own_method(&self) -> &'static str {
        let beyond = chapter5_beyond::ITEMS.iter().chain(chapter5_accuracy::ITEMS).any(|i| i.id == self.id);
        let of_five = self.id.ends_with(|c: char| c.is_ascii_digit()) && self.id.contains("-5.");
        if beyond || of_five { "polar" } else { "weak form" }
    }

    /// For a terminal.
    pub fn text(&self) -> String {
        let mut out = format!("{}  {}\n", self.id, self.title);
        let ours = self.rows.iter().any(|r| r.ours.is_some());
        out.push_str(&format!("  {:<44} {:>12} {:>12} {:>12}", "", "printed", "reproduced", "true"));
        out.push_str(&if ours { format!(" {:>12}\n", self.own_method()) } else { "\n".to_owned() });
        for r in &self.rows {
            let name = if r.unit.is_empty() { r.quantity.clone() } else { format!("{} / {}", r.quantity, r.unit) };
            out.push_str(&format!(
                "  {name:<44} {:>12} {:>12} {:>12}",
                cell(r.printed),
                cell(r.reproduced),
                cell(r.truth)
            ));
            out.push_str(&if ours { format!(" {:>12}\n", cell(r.ours)) } else { "\n".to_owned() });
        }
        for note in &self.notes {
            out.push_str(&format!("  {note}\n"));
        }
        out
    }

    /// For a report.
    pub fn html(&self) -> Html {
        let mut body = Html::new();
        let ours = self.rows.iter().any(|r| r.ours.is_some());
        let mut head = vec![(Html::text(""), Align::Left)];
        for name in ["printed", "reproduced", "true"] {
            head.push((Html::text(name), Align::Right));
        }
        if ours {
            head.push((Html::text(self.own_method()), Align::Right));
        }
        let rows: Vec<Vec<Html>> = self
            .rows
            .iter()
            .map(|r| {
                let name = if r.unit.is_empty() { r.quantity.clone() } else { format!("{} / {}", r.quantity, r.unit) };
                let mut row = vec![Html::text(&name)];
                row.extend([r.printed, r.reproduced, r.truth].map(|x| Html::text(&cell(x))));
                if ours {
                    row.push(Html::text(&cell(r.ours)));
                }
                row
            })
            .collect();
        if !rows.is_empty() {
            body.table(&head, &rows);
        }
        let (panels, columns, height) = &self.panels;
        if !panels.is_empty() {
            body.figure(&scatter(&self.title, *columns, *height, panels));
        }
        for note in &self.notes {
            body.paragraph(note);
        }
        body
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_unique_and_unknown_ones_are_told() {
        let mut ids: Vec<&str> = items().map(|i| i.id).collect();
        let count = ids.len();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), count);
        assert!(by_id("table-9.9").is_err_and(|e| e.to_string().contains("--list")));
        assert!(by_id("table-5.1").is_ok());
    }
}
