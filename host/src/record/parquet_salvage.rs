//! What can be read of a damaged row group: the rows whose page is whole in every column.
//!
//! Only for files of others, whose row groups may hold all of a record; whirl's own are 5 s long
//! and are dropped whole. A page that does not decode (or whose checksum, where it has one, is
//! wrong) takes its rows with it; a page header that is damaged takes the rest of its column, since
//! only it says where the next page begins; a damaged dictionary takes the pages that need it.
//! Where the rows that the page headers state do not add up to those of the row group, one of them
//! is wrong and rows could be shifted: nothing is read then.

use std::collections::VecDeque;
use std::sync::Arc;

use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::column::reader::{ColumnReader, get_column_reader};
use parquet::errors::Result as ParquetResult;
use parquet::file::metadata::RowGroupMetaData;
use parquet::file::reader::SerializedPageReader;
use parquet::schema::types::ColumnDescriptor;

use super::parquet_cells::{Cells, decode};
use super::parquet_chunks::{Failure, PART, caught, rows_in, take};
use super::parquet_recovery::checked_range;
use super::parquet_source::Source;
use super::parquet_structure::Columns;
use super::rows::Rows;
use crate::error::BadInput;

/// Reads what is whole of a row group from its row `from` on; `number` is the row group's, from 1.
/// Gives the first value that was wrong.
pub(super) fn salvage(
    source: &Arc<Source>,
    group: &RowGroupMetaData,
    number: usize,
    columns: &Columns,
    from: usize,
    why: &str,
    rows: &mut Rows<'_>,
) -> Option<BadInput> {
    let Ok(count) = rows_in(group) else {
        rows.lose(None, number, why);
        return None;
    };
    let walks: core::result::Result<Vec<Walk>, Failure> =
        columns.indices().into_iter().map(|column| caught(|| Walk::new(source, group, column))).collect();
    let Ok(mut walks) = walks else {
        rows.lose(Some(count - from.min(count)), number, why);
        return None;
    };
    let (mut at, mut wrong) = (0, None);
    while at < count {
        walks.iter_mut().filter(|w| w.left == 0).for_each(Walk::advance);
        let mut n = walks.iter().map(|w| w.left).min().unwrap_or(usize::MAX).min(count - at);
        let lost = walks.iter().find_map(|w| w.lost.clone());
        if lost.is_none() || at < from {
            n = n.min(PART);
        }
        if at < from {
            n = n.min(from - at);
        }
        let cells: Vec<core::result::Result<Cells, Failure>> = walks.iter_mut().map(|w| w.take(n)).collect();
        at += n;
        if at <= from {
            continue;
        }
        if let Some(lost) = lost {
            rows.lose(Some(n), number, &lost);
            continue;
        }
        let whole = rows.t.len();
        let taken = cells
            .into_iter()
            .collect::<core::result::Result<Vec<Cells>, Failure>>()
            .and_then(|cells| Ok(take(cells, columns.channels.len(), rows)?));
        if let Err(failure) = taken {
            rows.truncate(whole);
            let why = failure.reason();
            rows.lose(Some(n), number, &why);
            if let Failure::Bad(e) = failure {
                wrong.get_or_insert(*e);
            }
        }
    }
    wrong
}

/// The pages of a column chunk one after another, those that are damaged as rows without a value.
struct Walk {
    /// Goes from page header to page header; the pages themselves come from a reader of their own,
    /// which looks at their headers again.
    headers: SerializedPageReader<Source>,
    pages: SerializedPageReader<Source>,
    descriptor: Arc<ColumnDescriptor>,
    dictionary: Option<Page>,
    page: Option<ColumnReader>,
    /// Rows left of the page that is being read, or of what is lost, and why that is.
    left: usize,
    lost: Option<String>,
    /// Rows behind it.
    behind: usize,
}

impl Walk {
    /// Goes through the page headers first.
    fn new(source: &Arc<Source>, group: &RowGroupMetaData, column: usize) -> core::result::Result<Self, Failure> {
        let none = || Failure::File("a column is missing".to_owned());
        let chunk = group.columns().get(column).filter(|c| checked_range(c).is_some()).ok_or_else(none)?;
        let behind = rows_in(group)?;
        let mut headers = SerializedPageReader::new(source.clone(), chunk, behind, None)?;
        let mut stated = 0_usize;
        let whole = loop {
            match headers.peek_next_page() {
                Ok(Some(page)) => stated = stated.saturating_add(rows_of(&page)),
                Ok(None) => break true,
                Err(_) => break false,
            }
            if headers.skip_next_page().is_err() {
                break false;
            }
        };
        if stated > behind || (whole && stated < behind) {
            return Err(Failure::File(format!("its pages have {stated} rows, not {behind}")));
        }
        let descriptor = chunk.column_descr_ptr();
        let headers = SerializedPageReader::new(source.clone(), chunk, behind, None)?;
        let pages = SerializedPageReader::new(source.clone(), chunk, behind, None)?;
        Ok(Self { headers, pages, descriptor, dictionary: None, page: None, left: 0, lost: None, behind })
    }

    /// Goes on to the next page.
    fn advance(&mut self) {
        (self.page, self.lost) = (None, None);
        let name = self.descriptor.name().to_owned();
        loop {
            let next = caught(|| {
                let next = self.headers.peek_next_page()?;
                self.headers.skip_next_page()?;
                Ok(next)
            });
            let Ok(Some(next)) = next else {
                (self.left, self.behind) = (usize::MAX, 0);
                self.lost = Some(match next {
                    Err(_) => format!("a page header of column {name} is damaged"),
                    Ok(_) => format!("column {name} ends early"),
                });
                return;
            };
            let page = caught(|| Ok(self.pages.get_next_page()?)).ok().flatten();
            if next.is_dict {
                self.dictionary = page;
                continue;
            }
            self.left = rows_of(&next).min(self.behind);
            if self.left == 0 {
                continue;
            }
            self.behind -= self.left;
            match page {
                Some(page) => {
                    let pages = One(self.dictionary.iter().cloned().chain([page]).collect());
                    self.page = Some(get_column_reader(self.descriptor.clone(), Box::new(pages)));
                }
                None => self.lost = Some(format!("a page of column {name} is damaged")),
            }
            return;
        }
    }

    /// The next `n` rows, no more than are left. A page that does not decode is lost from there on.
    fn take(&mut self, n: usize) -> core::result::Result<Cells, Failure> {
        if self.left != usize::MAX {
            self.left -= n.min(self.left);
        }
        let why = format!("a page of column {} is damaged", self.descriptor.name());
        let cells = match (&mut self.page, &self.lost) {
            (Some(page), None) => caught(|| decode(page, &self.descriptor, n)),
            _ => Err(Failure::File(why.clone())),
        };
        if cells.is_err() && self.lost.is_none() {
            self.lost = Some(why);
        }
        cells
    }
}

/// Rows of a page of a column that is not nested: 0 for a dictionary.
fn rows_of(page: &PageMetadata) -> usize {
    if page.is_dict { 0 } else { page.num_rows.or(page.num_levels).unwrap_or(0) }
}

/// A page, behind its dictionary.
struct One(VecDeque<Page>);

impl Iterator for One {
    type Item = ParquetResult<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.pop_front().map(Ok)
    }
}

impl PageReader for One {
    fn get_next_page(&mut self) -> ParquetResult<Option<Page>> {
        Ok(self.0.pop_front())
    }

    fn peek_next_page(&mut self) -> ParquetResult<Option<PageMetadata>> {
        Ok(self.0.front().map(|page| PageMetadata {
            num_rows: None,
            num_levels: Some(page.num_values() as usize),
            is_dict: page.is_dictionary_page(),
        }))
    }

    fn skip_next_page(&mut self) -> ParquetResult<()> {
        self.0.pop_front();
        Ok(())
    }
}
