//! Columns of Parquet that hold more than one value in a row: lists, maps, structures. None is a
//! channel; where one is asked for, it is told what it is, and how its values become columns.

use std::path::Path;

use parquet::basic::{ConvertedType as Converted, LogicalType};
use parquet::schema::types::{SchemaDescriptor, Type};

use crate::error::{BadInput, plain};

/// What a nested column is.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    List,
    Map,
    Structure,
}

fn kind(column: &Type) -> Option<Kind> {
    let info = column.get_basic_info();
    if !column.is_group() {
        let repeated = info.has_repetition() && info.repetition() == parquet::basic::Repetition::REPEATED;
        return repeated.then_some(Kind::List);
    }
    Some(match (info.logical_type_ref(), info.converted_type()) {
        (Some(LogicalType::List), _) | (_, Converted::LIST) => Kind::List,
        (Some(LogicalType::Map), _) | (_, Converted::MAP | Converted::MAP_KEY_VALUE) => Kind::Map,
        _ => Kind::Structure,
    })
}

/// The error for a column of this name that has more than one value in a row; none where there is
/// no such column.
pub(super) fn nested(schema: &SchemaDescriptor, name: &str, path: &Path) -> Option<BadInput> {
    let column = schema.root_schema().get_fields().iter().find(|field| field.name() == name)?;
    let kind = kind(column)?;
    let leaves: Vec<_> =
        schema.columns().iter().filter(|leaf| leaf.path().parts().first().is_some_and(|p| p == name)).collect();
    let of = match &leaves[..] {
        [one] => format!(" of {}", one.physical_type()),
        _ => String::new(),
    };
    let shown = plain(name);
    let (word, remedy) = match kind {
        Kind::List => (
            "a list",
            format!("Save each element as a column of its own (in pandas: df[\"{shown}_1\"] = df[\"{shown}\"].str[0])"),
        ),
        Kind::Map | Kind::Structure => {
            let field =
                leaves.first().and_then(|leaf| leaf.path().parts().last()).map_or_else(String::new, |f| plain(f));
            let word = if kind == Kind::Map { "a map" } else { "a structure" };
            (
                word,
                format!(
                    "Save each field as a column of its own (in pandas: df[\"{shown}_{field}\"] = df[\"{shown}\"].str[\"{field}\"])"
                ),
            )
        }
    };
    Some(
        BadInput::new(format!("{word}{of} in every row"), "one number in every row: INT32, INT64, FLOAT or DOUBLE")
            .in_file(path)
            .at(format!("column {shown}"))
            .remedy(remedy),
    )
}
