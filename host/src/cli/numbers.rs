//! Options that are numbers.

use std::any::TypeId;

/// Lets every option that is a number take one below 0, so that the option itself says what it may
/// be, and not the parser that `-1` is no option.
pub fn below_0(command: clap::Command) -> clap::Command {
    let numbers = [
        TypeId::of::<f64>(),
        TypeId::of::<usize>(),
        TypeId::of::<u64>(),
        TypeId::of::<u32>(),
        TypeId::of::<u16>(),
        TypeId::of::<u8>(),
        TypeId::of::<i64>(),
        TypeId::of::<i32>(),
    ];
    let all = command.mut_args(|a| {
        if !a.get_action().takes_values() || !numbers.iter().any(|n| a.get_value_parser().type_id() == *n) {
            return a;
        }
        // `-1,0` is no number to the parser.
        if a.get_value_delimiter().is_some() { a.allow_hyphen_values(true) } else { a.allow_negative_numbers(true) }
    });
    all.mut_subcommands(below_0)
}

#[cfg(test)]
mod tests {
    #[test]
    fn options_that_are_numbers_take_those_below_0() {
        for line in [
            "simulate --model m.toml -o r.csv --initial -1,0 --seconds -1",
            "simulate --model m.toml -o r.csv --initial -1,-2.5",
            "identify r.csv --rig rig.toml --window-s -1 --low-pass -1",
            "explain r.csv --rig rig.toml --horizon -1 --forecast -1,2",
            "init r.csv -o rig.toml --drive-hz -5",
            "batch identify r.csv --rig rig.toml --out t.csv --pass-hz -3",
        ] {
            let words = std::iter::once("whirl").chain(line.split_whitespace());
            let parsed = crate::cli::command().try_get_matches_from(words);
            assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
        }
        let whole = crate::cli::command().try_get_matches_from("whirl identify r.csv --rig r --rounds -1".split(' '));
        assert!(whole.unwrap_err().to_string().contains("invalid value '-1' for '--rounds"));
    }
}
