//! Coefficients of their own for each record (`offset = { of = "1", each = "record" }`): columns
//! that are zero elsewhere.

use nalgebra::DVector;

use super::windows::WindowRows;
use crate::model::model_file::ModelFile;

/// How an equation's terms spread over columns.
#[derive(Clone, Debug)]
pub struct Split {
    /// For each equation and term: its name, and whether each record has its own.
    terms: Vec<Vec<(String, bool)>>,
    records: usize,
}

impl Split {
    /// For a model file and a number of records.
    pub fn new(model: &ModelFile, records: usize) -> Self {
        let terms = model
            .equations
            .iter()
            .map(|e| e.terms.iter().map(|t| (t.name.clone(), t.each_record && records > 1)).collect())
            .collect();
        Self { terms, records }
    }

    fn width(&self, own: bool) -> usize {
        if own { self.records } else { 1 }
    }

    /// Number of columns of each equation.
    pub fn terms(&self) -> Vec<usize> {
        self.terms.iter().map(|e| e.iter().map(|t| self.width(t.1)).sum()).collect()
    }

    /// Names of all columns, equation by equation; a record's own coefficients are `name_1`,
    /// `name_2` …
    pub fn names(&self) -> Vec<String> {
        self.terms
            .iter()
            .flatten()
            .flat_map(|(name, own)| {
                (0..self.width(*own)).map(move |r| if *own { format!("{name}_{}", r + 1) } else { name.clone() })
            })
            .collect()
    }

    /// A unit for each column from one for each term.
    pub fn units(&self, of: &[Vec<String>]) -> Vec<String> {
        self.terms
            .iter()
            .zip(of)
            .flat_map(|(terms, units)| {
                terms.iter().zip(units).flat_map(|((_, own), u)| std::iter::repeat_n(u.clone(), self.width(*own)))
            })
            .collect()
    }

    /// Spreads the columns of every window; `record_of[run]` is the record of a stretch.
    pub fn spread(&self, rows: &mut [WindowRows], record_of: &[usize]) {
        if !self.terms.iter().flatten().any(|t| t.1) {
            return;
        }
        let columns = self.terms();
        for window in rows {
            let record = record_of.get(window.run).copied().unwrap_or(0);
            for ((values, terms), &p) in window.equations.iter_mut().zip(&self.terms).zip(&columns) {
                let from = terms.len() + 1;
                let mut out = Vec::with_capacity(values.len() / from * (p + 1));
                for row in values.chunks_exact(from) {
                    for ((_, own), x) in terms.iter().zip(row) {
                        for r in 0..self.width(*own) {
                            out.push(if *own && r != record { 0.0 } else { *x });
                        }
                    }
                    out.push(row[from - 1]);
                }
                *values = out;
            }
        }
    }

    /// Coefficients of each equation's columns from values by name.
    pub fn tied(&self, names: &[String], values: &DVector<f64>) -> Vec<DVector<f64>> {
        let all: Vec<f64> =
            self.names().iter().map(|n| names.iter().position(|x| x == n).map_or(0.0, |i| values[i])).collect();
        let mut at = 0;
        self.terms()
            .into_iter()
            .map(|p| {
                at += p;
                DVector::from_column_slice(&all[at - p..at])
            })
            .collect()
    }

    /// Coefficients of an equation's terms in one record.
    pub fn of_record(&self, equation: usize, columns: &DVector<f64>, record: usize) -> Vec<f64> {
        let mut at = 0;
        self.terms[equation]
            .iter()
            .map(|(_, own)| {
                let x = columns[at + if *own { record } else { 0 }];
                at += self.width(*own);
                x
            })
            .collect()
    }
}
