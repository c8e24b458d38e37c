//! Many records, one table: a row for each record, whatever finished first, and the same bytes
//! whether the table was made in one go, resumed, or merged from shards.
//!
//! | file | what |
//! |---|---|
//! | [`row`] | cells, and which columns a table has |
//! | [`answers`] | the cells of an identification, an explanation, a validation |
//! | [`table`] | the table as CSV and Parquet |
//! | [`journal`] | rows that are done, beside the table, for a batch that was killed |
//! | [`merge`] | shards into one table |

pub mod answers;
pub mod hash;
pub mod journal;
pub mod merge;
mod parquet;
pub mod row;
pub mod table;

/// Version of tables and journals.
pub const FORMAT: u32 = 1;
