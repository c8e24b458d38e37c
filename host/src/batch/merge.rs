//! Shards of one batch into one table.

use std::path::PathBuf;

use super::table::Table;
use crate::error::{BadInput, Result};

/// Records that a table lacks, at most so many by number.
const MOST: usize = 10;

/// A merged table.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// The table.
    pub table: Table,
    /// Records of the batch, those without a row included.
    pub of: usize,
    /// Records without a row, by their number in the batch.
    pub missing: Vec<usize>,
}

impl Merged {
    /// Which records have no row, in words.
    pub fn missing_in_words(&self) -> String {
        let shown: Vec<String> = self.missing.iter().take(MOST).map(ToString::to_string).collect();
        let more = if self.missing.len() > MOST { ", …" } else { "" };
        format!("no row for {} of {} records: {}{more}", self.missing.len(), self.of, shown.join(", "))
    }
}

/// Merges tables of one batch.
///
/// # Errors
/// Tables of different commands or runs; a record with two rows; not a single row.
pub fn merge(tables: Vec<(PathBuf, Table)>) -> Result<Merged> {
    let mut rows: Vec<(usize, crate::batch::row::Row)> = Vec::new();
    let mut first: Option<(usize, String, String, i64)> = None;
    for (i, (path, table)) in tables.iter().enumerate() {
        for row in &table.rows {
            let of = (table.command.clone(), row.text_of("run").to_owned(), row.integer_of("of"));
            let (k, command, run, records) = first.get_or_insert((i, of.0.clone(), of.1.clone(), of.2));
            if (&of.0, &of.1, &of.2) != (command, run, records) {
                return Err(BadInput::new(
                    format!("rows of another run ({} {}, {} records)", of.0, of.1, of.2),
                    format!("{command} {run}, {records} records, as in {}", tables[*k].0.display()),
                )
                .in_file(path)
                .at(format!("row of {}", row.text_of("file")))
                .remedy("Merge shards of one list of records with the same options, rig file and version of whirl"));
            }
            rows.push((i, row.clone()));
        }
    }
    let Some((_, command, _, of)) = first else {
        return Err(BadInput::new("no row in any table", "at least one").remedy("Name the tables of all shards"));
    };
    rows.sort_by_key(|(_, row)| row.integer_of("index"));
    let twice = rows.windows(2).find(|pair| pair[0].1.integer_of("index") == pair[1].1.integer_of("index"));
    if let Some([a, b]) = twice {
        return Err(BadInput::new(
            format!("record {} ({}) a second time", b.1.integer_of("index"), b.1.text_of("file")),
            format!("each record once; {} has it", tables[a.0].0.display()),
        )
        .in_file(&tables[b.0].0)
        .remedy("Name each shard's table once"));
    }
    let of = usize::try_from(of).unwrap_or(0);
    let there: std::collections::BTreeSet<i64> = rows.iter().map(|(_, row)| row.integer_of("index")).collect();
    let missing = (1..=of).filter(|i| !i64::try_from(*i).is_ok_and(|i| there.contains(&i))).collect();
    Ok(Merged { table: Table::new(&command, rows.into_iter().map(|(_, row)| row).collect()), of, missing })
}

#[cfg(test)]
mod tests {
    use super::super::table::Layout;
    use super::super::table::tests::rows;
    use super::*;

    fn table(rows: Vec<crate::batch::row::Row>) -> (PathBuf, Table) {
        (PathBuf::from(format!("{}.csv", rows.len())), Table::new("identify", rows))
    }

    #[test]
    fn shards_give_the_bytes_of_one_run() {
        let shard = |i: usize| table(rows().into_iter().skip(i).step_by(3).collect());
        let merged = merge(vec![shard(2), shard(0), table(Vec::new()), shard(1)]).unwrap();
        assert_eq!((merged.of, merged.missing.len()), (4, 0));
        for layout in [Layout::Csv, Layout::Parquet] {
            let whole = Table::new("identify", rows()).bytes(layout).unwrap();
            assert_eq!(merged.table.bytes(layout).unwrap(), whole);
        }
        let partly = merge(vec![shard(0)]).unwrap();
        assert_eq!(partly.missing_in_words(), "no row for 2 of 4 records: 2, 3");
    }

    #[test]
    fn what_does_not_belong_together_is_refused() {
        let error = |tables| merge(tables).unwrap_err().to_string();
        assert!(error(vec![table(rows()), table(rows())]).contains("record 1 (r, \"1\".csv) a second time"));
        let mut other = rows();
        other[3].text("run", "fedcba9876543210");
        let text = error(vec![table(rows()[..2].to_vec()), table(other[3..].to_vec())]);
        assert!(text.contains("1.csv: row of -4.csv: found rows of another run") && text.contains("as in 2.csv"));
        assert!(error(vec![table(Vec::new())]).contains("no row in any table"));
    }
}
