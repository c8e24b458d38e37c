//! The name that was meant, where another was written.

/// The one of some names that differs least from what was written, where half of its letters or
/// more are right; case does not matter. Of several the first.
pub fn closest<'a>(written: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = written.to_lowercase();
    names
        .into_iter()
        .filter(|name| !name.is_empty())
        .map(|name| (distance(&name.to_lowercase(), &lower), name))
        .min_by_key(|(d, _)| *d)
        .filter(|(d, _)| *d <= written.chars().count().div_ceil(2).max(1))
        .map(|(_, name)| name)
}

/// The question before a remedy, `Did you mean drive? `, where one of the names is close.
pub fn did_you_mean<'a>(written: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    closest(written, names).map_or_else(String::new, |name| format!("Did you mean {name}? "))
}

/// Levenshtein distance of two short names (longer ones are cut to 64 characters).
fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().take(64).collect(), b.chars().take(64).collect());
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let next = (diagonal + usize::from(x != y)).min(row[j] + 1).min(row[j + 1] + 1);
            diagonal = row[j + 1];
            row[j + 1] = next;
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closest_name_is_meant() {
        assert_eq!((distance("kitten", "sitting"), distance("", "abc")), (3, 3));
        assert_eq!(closest("count1", ["t", "cuont1", "speed"]), Some("cuont1"));
        assert_eq!(closest("count1", ["t", "", "velocity"]), None);
        assert_eq!(
            did_you_mean("double-pendulm", ["single-pendulum", "double-pendulum"]),
            "Did you mean double-pendulum? "
        );
        assert_eq!(did_you_mean("drvie", ["name", "drive", "plant"]), "Did you mean drive? ");
        assert_eq!(did_you_mean("colour", ["name", "channel", "known"]), "");
    }
}
