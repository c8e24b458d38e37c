//! JSON Schemas of results: keys, words, what may be `null` or left out come from `docs/json.md`,
//! types from real results; and a validator for what stands in them.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Map, Value, json};

/// What the page says of a key.
#[derive(Clone, Debug, Default)]
pub struct Key {
    /// Its words.
    pub text: String,
    /// May be `null`.
    pub null: bool,
    /// May be left out.
    pub left_out: bool,
    /// The command and path whose keys it has too.
    pub as_of: Option<(String, String)>,
}

/// Keys by path (`""`, `record`, `effects[]`, …), in the page's order, for each command.
pub type Page = BTreeMap<String, BTreeMap<String, Vec<(String, Key)>>>;

/// Reads the page.
pub fn page(text: &str) -> Page {
    let mut page = Page::new();
    let (mut command, mut path) = (String::new(), String::new());
    for line in text.lines() {
        if let Some(title) = line.strip_prefix("## ") {
            command = title.trim_matches('`').to_owned();
            path.clear();
        } else if let Some(rest) = line.strip_prefix("**`") {
            path = rest.split('`').next().unwrap_or_default().to_owned();
        } else if let Some((keys, what)) = line.strip_prefix("| `").and_then(|l| l.split_once(" | ")) {
            let what = what.trim_end_matches(" |");
            let keys: Vec<String> =
                keys.split('`').step_by(2).filter(|k| !k.trim().is_empty()).map(str::to_owned).collect();
            let table = page.entry(command.clone()).or_default().entry(path.clone()).or_default();
            keys.into_iter().for_each(|key| table.push((key, of_words(what))));
        }
    }
    // What stands under the heading is one of a list.
    if let Some(warnings) = page.get_mut("Warnings")
        && let Some(keys) = warnings.get("").cloned()
    {
        warnings.insert("each[]".to_owned(), keys);
    }
    page
}

fn of_words(what: &str) -> Key {
    let as_of = what.split_once("(keys: ").and_then(|(_, r)| r.split(')').next()).map(|r| match r.split_once(", ") {
        Some((command, path)) => (command.to_owned(), path.to_owned()),
        None => (r.to_owned(), String::new()),
    });
    let mut text = what.replace(" (below)", "");
    if let Some((before, after)) = text.split_once(" (keys: ") {
        text = format!("{before}{}", after.split_once(')').map_or("", |(_, a)| a));
    }
    Key {
        null: what.contains("`null`"),
        left_out: what.to_lowercase().contains("left out"),
        text: text
            .replace(" Left out where there is none.", "")
            .replace(" `null` where there is none.", "")
            .replace('`', ""),
        as_of,
    }
}

/// Paths that are maps from names of things: their keys are no keys of results.
const MAPS: [&str; 7] = ["known", "verdicts", "initial", "options", "std_errors", "settings.known", "goals"];

/// Builds the schema of a command's result from the page, with the types of real results and of the
/// schema that there was. What is required is so where nothing went wrong with the record:
/// otherwise `error` says what.
pub fn schema(page: &Page, command: &str, results: &[&Value], before: Option<&Value>) -> Value {
    let before = before.cloned().map(|mut b| {
        b["required"] = b["else"]["required"].take();
        b
    });
    let mut schema = object(page, command, "", results, before.as_ref(), 0);
    schema["properties"]["format"] = json!({ "const": 1, "description": "Version of the result." });
    let message = "Where a record is at fault, so that nothing could be computed: the message. Only format, parameters and warnings stand beside it.";
    match schema["properties"].get_mut("error").and_then(Value::as_object_mut) {
        // A result that has a key of this name.
        Some(own) => {
            let told = own["description"].as_str().unwrap_or_default().to_owned();
            own.insert("description".into(), json!(format!("{told} As a string: {message}")));
            with_type(own, "string");
        }
        None => schema["properties"]["error"] = json!({ "type": "string", "description": message }),
    }
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": format!("whirl {command}: the result as JSON"),
        "type": "object",
        "required": ["format"],
        "if": { "required": ["error"], "properties": { "error": { "type": "string" } } },
        "else": { "required": schema["required"] },
        "properties": schema["properties"],
    })
}

fn strings(list: &Value) -> BTreeSet<String> {
    list.as_array().into_iter().flatten().filter_map(|s| s.as_str().map(str::to_owned)).collect()
}

/// Deepest result within a result.
const DEEPEST: usize = 12;

fn object(page: &Page, command: &str, path: &str, found: &[&Value], before: Option<&Value>, depth: usize) -> Value {
    let table = page.get(command).and_then(|c| c.get(path));
    let objects: Vec<&Map<String, Value>> = found.iter().filter_map(|v| v.as_object()).collect();
    let mut properties = Map::new();
    let mut required = BTreeSet::new();
    let was = before.map_or_else(BTreeSet::new, |b| strings(&b["required"]));
    for (key, said) in table.into_iter().flatten() {
        let values: Vec<&Value> = objects.iter().filter_map(|o| o.get(key)).collect();
        let old = before.and_then(|b| b["properties"].get(key));
        // In each result that was seen now, and in each before.
        let always = !objects.is_empty() && values.len() == objects.len() && (old.is_none() || was.contains(key));
        if !said.left_out && (always || (objects.is_empty() && (was.contains(key) || old.is_none()))) {
            required.insert(key.clone());
        }
        let (of, at) = match &said.as_of {
            Some((c, _)) if c == "Warnings" => (c.clone(), "each".to_owned()),
            Some((c, p)) => (c.clone(), p.trim_end_matches("[]").to_owned()),
            None => (command.to_owned(), if path.is_empty() { key.clone() } else { format!("{path}.{key}") }),
        };
        let mut schema = value(page, (&of, &at), &values, old, depth + 1);
        schema.insert("description".into(), json!(said.text));
        if said.null {
            with_type(&mut schema, "null");
        }
        properties.insert(key.clone(), Value::Object(schema));
    }
    json!({ "type": "object", "required": required, "properties": properties })
}

/// Adds a type, where types are told at all.
fn with_type(schema: &mut Map<String, Value>, kind: &str) {
    if let Some(of) = schema.get("type").cloned() {
        let mut all =
            if of.is_string() { BTreeSet::from([of.as_str().unwrap_or_default().to_owned()]) } else { strings(&of) };
        all.insert(kind.to_owned());
        schema.insert("type".into(), types(&all));
    }
}

fn types(all: &BTreeSet<String>) -> Value {
    match all.len() {
        1 => json!(all.first()),
        _ => json!(all),
    }
}

fn kinds(of: &Value) -> BTreeSet<String> {
    match of {
        Value::String(s) => BTreeSet::from([s.clone()]),
        other => strings(other),
    }
}

/// The schema of a value, and of what is in it.
fn value(page: &Page, at: (&str, &str), found: &[&Value], before: Option<&Value>, depth: usize) -> Map<String, Value> {
    let mut out = Map::new();
    let (command, path) = at;
    let mut all = before.map_or_else(BTreeSet::new, |b| kinds(&b["type"]));
    all.extend(found.iter().map(|v| kind(v).to_owned()));
    // No result that was seen had a value: what it is is not told.
    if all.len() == 1 && all.contains("null") {
        all.clear();
    }
    if all.contains("number") {
        all.remove("integer");
        // One that is no number is null.
        all.insert("null".into());
    }
    if !all.is_empty() {
        out.insert("type".into(), types(&all));
    }
    if depth > DEEPEST {
        return out;
    }
    let within = |path: &str| page.get(command).is_some_and(|c| c.contains_key(path));
    let named = path.rsplit('.').next().unwrap_or_default();
    if all.contains("array") || within(&format!("{path}[]")) {
        let items: Vec<&Value> = found.iter().filter_map(|v| v.as_array()).flatten().collect();
        let old = before.and_then(|b| b.get("items"));
        if !items.is_empty() || old.is_some() || within(&format!("{path}[]")) {
            let item = value(page, (command, &format!("{path}[]")), &items, old, depth + 1);
            out.insert("items".into(), Value::Object(item));
        }
    }
    let table = within(path);
    if table && !MAPS.contains(&named) && (all.contains("object") || all.is_empty()) {
        let objects: Vec<&Value> = found.iter().copied().filter(|v| v.is_object()).collect();
        let inner = object(page, command, path, &objects, before, depth);
        for key in ["required", "properties"] {
            out.insert(key.into(), inner[key].clone());
        }
    }
    out
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(n) if n.is_f64() => "number",
        Value::Number(_) => "integer",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    }
}

/// What a value violates of a schema: types, required keys, constants. Keys that a schema does not
/// name may be added.
pub fn violations(value: &Value, schema: &Value, path: &str, out: &mut Vec<String>) {
    if let Some(constant) = schema.get("const")
        && constant != value
    {
        out.push(format!("{path}: {value} instead of {constant}"));
    }
    if let Some(of) = schema.get("type") {
        let all = kinds(of);
        let whole = kind(value) == "integer" && all.contains("number");
        if !all.contains(kind(value)) && !whole {
            out.push(format!("{path}: {} instead of {of}", kind(value)));
            return;
        }
    }
    if let Some(object) = value.as_object() {
        let mut required = strings(schema.get("required").unwrap_or(&Value::Null));
        if let Some(otherwise) = schema.get("else").filter(|_| !object.get("error").is_some_and(Value::is_string)) {
            required.extend(strings(&otherwise["required"]));
        }
        for key in required {
            if !object.contains_key(&key) {
                out.push(format!("{path}.{key}: missing"));
            }
        }
        for (key, inner) in object {
            if let Some(of) = schema.get("properties").and_then(|p| p.get(key)) {
                violations(inner, of, &format!("{path}.{key}"), out);
            }
        }
    }
    if let (Some(list), Some(of)) = (value.as_array(), schema.get("items")) {
        list.iter().enumerate().for_each(|(i, v)| violations(v, of, &format!("{path}[{i}]"), out));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_schema_holds_what_the_page_and_a_result_say() {
        let page = page(
            "## Warnings\n| key | what |\n|---|---|\n| `id` | a name |\n## `x`\n| `a` | A number. `null` where there is none. |\n| `b`, `c` | Two. Left out where there is none. |\n\
             | `list` | Things (below). |\n| `warnings` | Noticed (keys: Warnings). |\n**`list[]`**: a thing\n| `d` | D. |\n",
        );
        let result = json!({ "format": 1, "a": 1.5, "list": [{ "d": "x" }], "warnings": [], "b": 2 });
        let schema = schema(&page, "x", &[&result], None);
        assert_eq!(schema["else"]["required"], json!(["a", "list", "warnings"]));
        assert_eq!(schema["required"], json!(["format"]));
        assert_eq!(schema["properties"]["a"]["type"], json!(["null", "number"]));
        assert_eq!(schema["properties"]["list"]["items"]["properties"]["d"]["type"], "string");
        assert_eq!(schema["properties"]["b"]["description"], "Two.");
        let told = |value: Value| {
            let mut out = Vec::new();
            violations(&value, &schema, "x", &mut out);
            out
        };
        assert!(told(result.clone()).is_empty());
        assert!(told(json!({ "format": 1, "parameters": [], "warnings": [], "error": "a dead channel" })).is_empty());
        assert_eq!(told(json!({ "format": 2, "a": null, "list": [{}], "warnings": 3 })).len(), 3);
        assert_eq!(
            told(json!({ "format": 1, "a": "1", "list": [], "warnings": [] })),
            ["x.a: string instead of [\"null\",\"number\"]"]
        );
        // Built again from itself it stays as it is.
        assert_eq!(super::schema(&page, "x", &[], Some(&schema)), schema);
    }
}
