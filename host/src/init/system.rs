//! Which system a record is of, and which column shows which of its coordinates and inputs.

use std::path::Path;

use super::columns::{Kind, Seen};
use super::meant::{self, Need, channel, meant, words};
use super::raw::{Raw, no_such_column};
use super::{DraftChannel, Settings, Statement};
use crate::error::{BadInput, Result};
use crate::model::MODELS;
use crate::model::model_file::toml_place::{self, Source};
use crate::model::model_file::{self, Space};
use crate::rig::Channel;
use crate::rig::declared::{self, Declared};
use crate::rig::measures::BASE;
use crate::system::library::Pendulum;
use crate::system::{self, library};
use crate::wording::format::shell_word;

/// What to do for a system that is not in the list: a mass on a spring as the example.
const OF_ONES_OWN: &str = "For another system write its equation of motion into a model file, a few lines for a mass on a spring: \
     name = \"mass on a spring\", coordinates = [{ name = \"x\", space = \"R\" }], then [[equation]] with balance = \"-x''\" \
     and terms = { k = \"x\", c = \"x'\" }; see docs/model-file.md";

/// What was chosen.
pub(super) struct Chosen {
    pub model: Option<String>,
    pub why: Vec<Statement>,
    pub channels: Vec<DraftChannel>,
    pub unused: Vec<Statement>,
    /// Whether a drive is to be looked for.
    pub may_be_driven: bool,
}

/// What a system needs.
struct Needs {
    list: Vec<Need>,
    phase: bool,
}

fn built_in(id: &str) -> Option<Needs> {
    let angle = |n: &&str| Need { name: (*n).to_owned(), kind: Kind::Angle, declared: Some(Declared::angle()) };
    Some(Needs { list: Pendulum::named(id)?.encoders().iter().map(angle).collect(), phase: true })
}

fn of_source(source: Source) -> Result<Needs> {
    let model = system::model_of(source, None, 1.0)?;
    let (coordinates, inputs) = declared::of_model(&model);
    let coordinate = |(c, declared): (&model_file::Coordinate, Option<Declared>)| Need {
        name: c.name.clone(),
        kind: if c.space == Space::Circle { Kind::Angle } else { Kind::Length },
        declared,
    };
    // The base's position is made an acceleration of.
    let input = |(u, declared): (&String, Option<Declared>)| Need {
        name: u.clone(),
        kind: Kind::Input,
        declared: declared.filter(|_| u != BASE),
    };
    let phase = model.uses_phase();
    let inputs = model.inputs.iter().zip(inputs).map(input);
    Ok(Needs { list: model.coordinates.iter().zip(coordinates).map(coordinate).chain(inputs).collect(), phase })
}

/// The model as the rig file names it, and what it needs.
fn named(system: &str, output: &Path) -> Result<(String, Needs)> {
    if let Some(needs) = built_in(system) {
        return Ok((system.to_owned(), needs));
    }
    if let (false, Some(text)) = (model_file::is_path(system), library::text(system)) {
        let source = Source { text: text.to_owned(), path: Path::new(system).to_path_buf() };
        return Ok((system.to_owned(), of_source(source)?));
    }
    if !model_file::is_path(system) {
        let names: Vec<&str> = MODELS.iter().map(|m| m.0).chain(library::all().iter().map(|l| l.0)).collect();
        return Err(BadInput::new(format!("\"{system}\""), format!("one of {}, or a model file", names.join(", ")))
            .at("--system")
            .remedy(format!("`whirl list models` says what they are. {OF_ONES_OWN}")));
    }
    let needs = of_source(toml_place::read(Path::new(system), "a model file")?)?;
    // Paths in a rig file are relative to it.
    let here = output.parent().is_none_or(|p| p.as_os_str().is_empty());
    let path = if here {
        Path::new(system).to_path_buf()
    } else {
        Path::new(system).canonicalize().unwrap_or_else(|_| system.into())
    };
    Ok((path.display().to_string(), needs))
}

/// Chooses the system and assigns columns.
pub(super) fn choose(raw: &Raw, seen: &[Seen], settings: &Settings) -> Result<Chosen> {
    // Counts of a cart are no angle's.
    let is_rail = |s: &Seen| s.unit == "count" && s.counts.is_none() && is_of_rail(&s.name);
    let rails = seen.iter().filter(|s| is_rail(s)).count();
    let angles = seen.iter().filter(|s| s.kind == Kind::Angle).count() - rails;
    let guess = match angles {
        _ if rails > 0 => None,
        1 => Some(Pendulum::Single.id()),
        2 => Some(Pendulum::Double.id()),
        _ => None,
    };
    let model = settings.system.as_deref().or(guess);
    let Some(model) = model else {
        if settings.needs_system {
            return Err(untold(raw, seen, angles));
        }
        return as_they_stand(raw, seen);
    };
    let (model, mut needs) = named(model, &settings.output)?;
    let mut why = Vec::new();
    if settings.system.is_none() {
        let text = format!("{angles} column{} of angles", if angles == 1 { "" } else { "s" });
        why.push(Statement::new("model", &model, format!("{text}; another system is told by --system")));
    }
    let (columns, chosen) = assign(raw, seen, &mut needs, settings)?;
    why.extend(chosen);
    let mut unused = Vec::new();
    for s in seen.iter().filter(|s| !columns.iter().any(|c| c.index == s.index)) {
        let computed = columns.iter().find(|c| s.is_in(&c.name));
        let why = if let Some(of) = computed {
            format!("stands in {}", of.name)
        } else if matches!(s.kind, Kind::Angle | Kind::Length | Kind::Input) {
            format!("{}, which {model} has no place for", s.kind.words())
        } else {
            s.kind.words().to_owned()
        };
        let statement = Statement::new(&s.name, "not used", why);
        unused.push(
            match needs.list.iter().find(|n| n.refuses(s) && (n.kind == s.kind || same_name(&s.name, &n.name))) {
                Some(n) => {
                    let why = format!("its unit {} is none of {}, {}", s.unit, n.name, n.words());
                    Statement::new(&s.name, "not used", why).unsure()
                }
                None => statement,
            },
        );
    }
    if settings.system.is_none()
        && let Some(of) = forces(&unused, seen)
    {
        let text = format!(
            "it has no place for {of}, and a measured force seldom stands in a record for nothing: name the system that it acts on with --system"
        );
        why.push(Statement::new("model", &model, text).unsure());
    }
    let channels = columns.iter().zip(&needs.list).map(|(s, n)| channel(&meant(s, n), &n.name)).collect();
    Ok(Chosen { model: Some(model), why, channels, unused, may_be_driven: needs.phase })
}

/// Columns of forces or torques among those that are not used.
fn forces(unused: &[Statement], seen: &[Seen]) -> Option<String> {
    let is_force =
        |name: &str| seen.iter().any(|s| s.name == name && ["N", "N m"].contains(&Channel::new("", s.unit).si_unit()));
    let list: Vec<&str> = unused.iter().map(|s| s.of.as_str()).filter(|name| is_force(name)).collect();
    (!list.is_empty()).then(|| list.join(", "))
}

/// Whether a column is called after what moves along a rail.
fn is_of_rail(column: &str) -> bool {
    const RAILS: [&str; 8] = ["cart", "rail", "slide", "carriage", "wagen", "schlitten", "trolley", "linear"];
    let base = crate::record::names::split(column).0.to_lowercase();
    base.split(|c: char| !c.is_alphabetic()).any(|word| RAILS.iter().any(|r| word.starts_with(r)))
}

/// A channel for each column that moves, of no system.
fn as_they_stand(raw: &Raw, seen: &[Seen]) -> Result<Chosen> {
    let moves = |s: &&Seen| !matches!(s.kind, Kind::Counter | Kind::Constant);
    let channels: Vec<DraftChannel> = seen.iter().filter(moves).map(|s| channel(s, &s.name)).collect();
    if channels.is_empty() {
        return Err(super::nothing_to_measure(raw, seen));
    }
    let left = seen.iter().filter(|s| !moves(s)).map(|s| Statement::new(&s.name, "not used", s.kind.words()));
    Ok(Chosen { model: None, why: Vec::new(), channels, unused: left.collect(), may_be_driven: false })
}

/// The column of each quantity: the one that `--map` says, that is called so, or the next of its
/// kind; of more than there is need for those that move most, which is said.
fn assign<'a>(
    raw: &Raw,
    seen: &'a [Seen],
    needs: &mut Needs,
    settings: &Settings,
) -> Result<(Vec<&'a Seen>, Vec<Statement>)> {
    let mut out: Vec<Option<&Seen>> = vec![None; needs.list.len()];
    for (measure, column) in &settings.choices.map {
        let names: Vec<String> = seen.iter().map(|s| s.name.clone()).collect();
        let found = seen.iter().find(|s| s.name == *column);
        let found = found.ok_or_else(|| no_such_column(&raw.path, column, &names))?;
        let Some(k) = needs.list.iter().position(|n| n.name == *measure || n.name == measure.replace("phi", "theta"))
        else {
            let list: Vec<&str> = needs.list.iter().map(|n| n.name.as_str()).collect();
            return Err(BadInput::new(format!("\"{measure}\""), format!("one of {}", list.join(", "))).at("--map"));
        };
        if needs.list[k].refuses(found) && !meant::may_be(found, &needs.list[k]) {
            return Err(BadInput::new(
                format!("{column}, {}", words(found)),
                format!("a column for {measure}, {}", needs.list[k].words()),
            )
            .in_file(&raw.path)
            .at("--map")
            .remedy(meant::OTHERWISE));
        }
        out[k] = Some(found);
        needs.list[k].name.clone_from(measure);
    }
    let mut free: Vec<&Seen> = seen
        .iter()
        .filter(|s| !matches!(s.kind, Kind::Counter | Kind::Constant | Kind::Other))
        .filter(|s| !out.iter().flatten().any(|o| o.index == s.index))
        .collect();
    for (k, need) in needs.list.iter().enumerate().filter(|(k, _)| out[*k].is_none()).collect::<Vec<_>>() {
        let called = |f: fn(&str, &str) -> bool| free.iter().position(|s| f(&s.name, &need.name) && !need.refuses(s));
        if let Some(i) = called(same_name).or_else(|| called(same_arm)) {
            out[k] = Some(free.remove(i));
        }
    }
    // One column alone that has it among its words.
    for (k, need) in needs.list.iter().enumerate().filter(|(k, _)| out[*k].is_none()).collect::<Vec<_>>() {
        let mut called = (0..free.len()).filter(|i| has_word(&free[*i].name, &need.name));
        if let (Some(i), None) = (called.next(), called.next()) {
            out[k] = Some(free.remove(i));
        }
    }
    let mut why = Vec::new();
    // First those whose kind fits, then any whose kind nothing says.
    for wanted in [false, true] {
        for k in 0..needs.list.len() {
            let need = &needs.list[k];
            let fits =
                |s: &&Seen| !need.refuses(s) && if wanted { s.kind == Kind::Unknown } else { s.kind == need.kind };
            let open =
                |(other, column): &(&Need, &Option<&Seen>)| column.is_none() && (wanted || other.kind == need.kind);
            let count = needs.list.iter().zip(&out).filter(open).count();
            let possible: Vec<&Seen> = free.iter().copied().filter(fits).collect();
            let Some(found) = next(&possible, count).filter(|_| out[k].is_none()) else { continue };
            if possible.len() > count {
                why.push(one_of(found, &possible, &need.name));
            }
            free.retain(|s| s.index != found.index);
            out[k] = Some(found);
        }
    }
    match out.iter().position(Option::is_none) {
        None => Ok((out.into_iter().flatten().collect(), why)),
        Some(k) => {
            let list: Vec<String> = seen.iter().map(|s| format!("{} ({})", s.name, words(s))).collect();
            Err(BadInput::new(
                list.join(", "),
                format!("a column for {}, {}", needs.list[k].name, needs.list[k].words()),
            )
            .in_file(&raw.path)
            .at("columns")
            .remedy(format!(
                "Say which one it is: --map {}=COLUMN; or name another system with --system",
                needs.list[k].name
            )))
        }
    }
}

/// The first of the `count` columns that move most, or of all where they are in several units.
fn next<'a>(possible: &[&'a Seen], count: usize) -> Option<&'a Seen> {
    let mut most: Vec<&Seen> = possible.to_vec();
    if comparable(possible) {
        most.sort_by(|a, b| b.range.total_cmp(&a.range));
        most.truncate(count);
    }
    possible.iter().copied().find(|s| most.iter().any(|m| m.index == s.index))
}

/// Whether columns are in units of one kind, so that the ranges of their values compare.
fn comparable(columns: &[&Seen]) -> bool {
    let si = |s: &Seen| Channel::new("", s.unit).si_unit().to_owned();
    columns.windows(2).all(|w| si(w[0]) == si(w[1]))
}

/// What is said of a column that is one of several which may be meant.
fn one_of(found: &Seen, possible: &[&Seen], need: &str) -> Statement {
    let others: Vec<&str> = possible.iter().filter(|s| s.index != found.index).map(|s| s.name.as_str()).collect();
    let how = if comparable(possible) { "it moves most" } else { "it stands first" };
    let option = format!("--map {need}={}", shell_word(others.first().unwrap_or(&"COLUMN")));
    let why = format!("{} may be meant as well, and {how}; another one is told by {option}", others.join(", "));
    Statement::new(&found.name, need, why).unsure()
}

fn same_name(column: &str, need: &str) -> bool {
    let base = crate::record::names::split(column).0;
    base.eq_ignore_ascii_case(need)
}

/// Whether a column is called after the arm that a channel of a built-in system shows: `phi1`,
/// `Theta 1` for theta1.
fn same_arm(column: &str, need: &str) -> bool {
    need.starts_with("theta") && arm(column).is_some_and(|said| said.replace("phi", "theta") == need)
}

/// What a column's name says of an arm's angle: theta1, theta2 (relative), phi1, phi2 (absolute),
/// in any spelling; none where it says another thing.
pub(super) fn arm(column: &str) -> Option<&'static str> {
    let base = crate::record::names::split(column).0.to_lowercase();
    let letters = base.replace('θ', "theta").replace(['φ', 'ϕ'], "phi");
    let plain: String = letters.chars().filter(|c| c.is_alphanumeric()).collect();
    ["theta1", "theta2", "phi1", "phi2"].into_iter().find(|name| *name == plain)
}

fn has_word(column: &str, need: &str) -> bool {
    let base = crate::record::names::split(column).0;
    base.split(|c: char| !c.is_alphanumeric()).any(|word| word.eq_ignore_ascii_case(need))
}

/// The error for columns that leave the system open: lists systems with as many coordinates and
/// inputs.
fn untold(raw: &Raw, seen: &[Seen], angles: usize) -> BadInput {
    let usable = |s: &&Seen| matches!(s.kind, Kind::Angle | Kind::Length | Kind::Input | Kind::Unknown);
    let columns: Vec<String> = seen.iter().filter(usable).map(|s| format!("{} ({})", s.name, s.kind.words())).collect();
    if columns.is_empty() {
        return super::nothing_to_measure(raw, seen);
    }
    let fits = |text: &str, name: &str| {
        let source = Source { text: text.to_owned(), path: Path::new(name).to_path_buf() };
        of_source(source).is_ok_and(|n| {
            n.list.len() == columns.len() && n.list.iter().filter(|n| n.kind == Kind::Angle).count() >= angles
        })
    };
    let names: Vec<&str> =
        library::all().iter().filter(|(name, text)| fits(text, name)).map(|(name, _)| *name).collect();
    let expected = if names.is_empty() { "a system that has so many channels".to_owned() } else { names.join(", ") };
    BadInput::new(
        format!("{} channel{}: {}", columns.len(), if columns.len() == 1 { "" } else { "s" }, columns.join(", ")),
        format!("to be told the system: {expected}, or a model file"),
    )
    .in_file(&raw.path)
    .at("--system")
    .remedy(format!("Name it with --system; `whirl list models` says what each is. {OF_ONES_OWN}"))
}
