//! From text to the structs of a file, with messages that name key, position, what is allowed and the fix.

use garde::Validate;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::Value;
use serde_saphyr::Error as Yaml;

use super::error::{ConfigError, Findings, missing};
use super::source::{At, Entry, Index, join};

/// Reads `T`; what lies outside its ranges is in the findings, to be told together with what else is wrong.
pub(super) fn read<'a, T>(text: &str, file: &'a str) -> Result<(T, Findings<'a>), ConfigError>
where
    T: DeserializeOwned + JsonSchema + Validate<Context = ()>,
{
    let index = Index::of(text).map_err(|e| no_yaml(&e, text, file))?;
    let options = serde_saphyr::options! { with_snippet: false };
    let value: T = serde_saphyr::from_str_with_options(text, options).map_err(|e| explain(&e, &index, file))?;
    let mut findings = Findings::new(file, index);
    let not_finite: Vec<_> = findings.index.not_finite().map(|e| (e.path.clone(), e.shown.clone())).collect();
    for (path, shown) in &not_finite {
        findings.add(path, format!("is {shown}: give a finite number"));
    }
    if let Err(report) = value.validate() {
        let schema = schemars::schema_for!(T).to_value();
        for (path, error) in report.iter() {
            let path = path.to_string();
            if !not_finite.iter().any(|(p, _)| *p == path) {
                let message = out_of_range(&schema, &findings.index, &path).unwrap_or_else(|| error.to_string());
                findings.add(&path, message);
            }
        }
    }
    Ok((value, findings))
}

/// `is 400, outside -10 to 10`, with the unit that was perhaps meant.
fn out_of_range(schema: &Value, index: &Index, path: &str) -> Option<String> {
    let [min, max] = bounds(schema, index, path)?;
    let shown = &index.find(path)?.shown;
    let hint = shown.parse().ok().and_then(|value| unit_hint(path, value, [min, max]));
    Some(format!("is {shown}, outside {min} to {max}{}", hint.unwrap_or_default()))
}

/// What the value would be in the unit that people mix up with the one of the key.
fn unit_hint(path: &str, value: f64, [min, max]: [f64; 2]) -> Option<String> {
    let key = path.rsplit('.').next()?.split('[').next()?;
    let inside = |v: f64| (min..=max).contains(&v);
    let degrees = 1f64.to_radians();
    let units: [(&str, f64, &str, &str); 7] = [
        ("_mm", 1e3, "metres", "millimetres"),
        ("_um", 1e6, "metres", "micrometres"),
        ("_m", 1e-3, "millimetres", "metres"),
        ("_m_s", 1e-3, "millimetres per second", "metres per second"),
        ("_rad", degrees, "degrees", "radians"),
        ("_rad_s", degrees, "degrees", "radians"),
        ("_rad_s2", degrees, "degrees", "radians"),
    ];
    let (_, factor, meant, taken) = units.into_iter().find(|(end, ..)| key.ends_with(end))?;
    inside(value * factor).then(|| format!(": is it in {meant}? this key takes {taken}"))
}

/// The range of the value at `path`, from the JSON Schema: the one place besides the check that knows it.
fn bounds(schema: &Value, index: &Index, path: &str) -> Option<[f64; 2]> {
    let steps = path.replace('[', ".[");
    let steps: Vec<&str> = steps.split('.').filter(|s| !s.is_empty()).collect();
    let found = walk(schema, schema, index, "", &steps)?;
    Some([found.get("minimum")?.as_f64()?, found.get("maximum")?.as_f64()?])
}

fn walk<'s>(root: &'s Value, node: &'s Value, index: &Index, path: &str, steps: &[&str]) -> Option<&'s Value> {
    if let Some(name) = node.get("$ref").and_then(Value::as_str) {
        return walk(root, root.pointer(name.strip_prefix('#')?)?, index, path, steps);
    }
    for choice in ["anyOf", "oneOf"].iter().filter_map(|c| node.get(c)?.as_array()).flatten() {
        let found = is_chosen(choice, index, path).then(|| walk(root, choice, index, path, steps)).flatten();
        if found.is_some() {
            return found;
        }
    }
    let Some((step, rest)) = steps.split_first() else {
        return node.get("minimum").map(|_| node);
    };
    if step.starts_with('[') {
        return walk(root, node.get("items")?, index, &format!("{path}{step}"), rest);
    }
    walk(root, node.get("properties")?.get(step)?, index, &join(path, step), rest)
}

/// Of the patterns of a segment, only the one that the file names.
fn is_chosen(choice: &Value, index: &Index, path: &str) -> bool {
    let Some(pattern) = choice.pointer("/properties/pattern/const").and_then(Value::as_str) else { return true };
    index.find(&join(path, "pattern")).is_some_and(|e| e.shown == format!("{pattern:?}"))
}

/// The problem of a text that is no YAML.
fn no_yaml(error: &Yaml, text: &str, file: &str) -> ConfigError {
    let error = error.without_snippet();
    let at = error.location().map_or(At::default(), At::from);
    let (message, at) = match (error, tab_in_indent(text)) {
        (Yaml::MultipleDocuments { .. }, _) => {
            ("a second YAML document begins: one file holds one document".into(), at)
        }
        (_, Some(at)) => ("not YAML: a tab in the indentation; indent with spaces".into(), at),
        (other, None) => (format!("not YAML: {}", plain_syntax(other)), at),
    };
    ConfigError::one(file, at, message)
}

/// The problem of a text that is no `T`.
fn explain(error: &Yaml, index: &Index, file: &str) -> ConfigError {
    let error = error.without_snippet();
    let at = error.location().map_or(At::default(), At::from);
    if let (Yaml::Message { msg, .. }, Some(entry)) = (error, index.at(at)) {
        // Of a segment, and reported at its first key.
        return ConfigError::one(file, at, format!("{} {msg}", mapping_of(entry, at)));
    }
    if let Yaml::SerdeMissingField { field, .. } = error {
        let parent = index.at(at).map_or("", |e| mapping_of(e, at));
        let at = index.find(parent).map_or(at, |e| e.at);
        let message = missing(parent, field, "");
        return ConfigError::one(file, at, if parent.is_empty() { message } else { format!("{parent} {message}") });
    }
    let entry = index.at(at);
    let (message, at) = said(error, entry, at);
    ConfigError::one(file, at, message)
}

/// The parser names the end of the line before.
fn tab_in_indent(text: &str) -> Option<At> {
    let lines = text.lines().map(|line| line.trim_start_matches(' ').starts_with('\t').then_some(line));
    let (row, line) = lines.enumerate().find_map(|(row, line)| Some((row, line?)))?;
    Some(At { line: row as u64 + 1, column: line.find('\t')? as u64 + 1 })
}

/// The mapping that an error about one of its keys means.
fn mapping_of(entry: &Entry, at: At) -> &str {
    if entry.key_at == Some(at) { parent_of(&entry.path) } else { &entry.path }
}

fn parent_of(path: &str) -> &str {
    path.rfind(['.', '[']).map_or("", |end| &path[..end])
}

fn said(error: &Yaml, entry: Option<&Entry>, at: At) -> (String, At) {
    let path = entry.map_or("the file", |e| if e.path.is_empty() { "the file" } else { &e.path });
    let shown = entry.map_or("something else", |e| &e.shown);
    let at_value = entry.map_or(at, |e| e.at);
    let wrong = |wanted: &str| (format!("{path} is {shown}, not {wanted}"), at_value);
    match error {
        Yaml::SerdeUnknownField { field, expected, .. } => (unknown_key(field, expected, path), at),
        Yaml::DuplicateMappingKey { key, .. } => {
            let key = key.as_deref().unwrap_or("?");
            (format!("{path} is given twice: remove one of the keys `{key}`"), at)
        }
        Yaml::SerdeUnknownVariant { variant, expected, .. } => {
            (format!("{path} is {variant:?}, not one of: {}", expected.join(", ")), at)
        }
        Yaml::InvalidScalar { ty, .. } => wrong(plain_type(ty)),
        Yaml::Unexpected { expected, .. } => wrong(plain_type(expected)),
        Yaml::SerdeInvalidType { expected, .. } | Yaml::SerdeInvalidValue { expected, .. } => {
            wrong(plain_type(expected))
        }
        Yaml::NullIntoString { .. } => wrong("text"),
        Yaml::SerdeInvalidLength { len, expected, .. } => {
            let wanted = expected.replace("an array of length ", "");
            (format!("{path} has {len} values, not {wanted}"), at_value)
        }
        Yaml::NonFiniteFloat { .. } => (format!("{path} is {shown}: give a finite number"), at_value),
        Yaml::Eof { .. } => ("the file is empty".into(), at),
        other => (format!("{path}: {}", plain_syntax(other)), at),
    }
}

fn unknown_key(field: &str, expected: &[&str], path: &str) -> String {
    let place = parent_of(path);
    let place = if place.is_empty() || path == "the file" { "the file".into() } else { format!("`{place}`") };
    let near = expected.iter().filter(|known| is_near(field, known)).min_by_key(|known| edits(field, known));
    let hint = near.map_or(String::new(), |known| format!(": did you mean `{known}`?"));
    format!("unknown key `{field}` in {place}{hint} (known: {})", expected.join(", "))
}

/// The same but for the unit at its end, or but for one or two letters.
fn is_near(a: &str, b: &str) -> bool {
    let stem = |s: &str| s.rsplit_once('_').map_or(s.to_owned(), |(stem, _)| stem.to_owned());
    stem(a) == b || a == stem(b) || (stem(a) == stem(b) && a.contains('_')) || edits(a, b) <= 2.min(a.len() / 3)
}

/// Letters to insert, delete or change.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut before = row.clone();
        std::mem::swap(&mut row, &mut before);
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            row[j + 1] = (before[j] + usize::from(ca != *cb)).min(before[j + 1] + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

/// A type as people call it.
fn plain_type(ty: &str) -> &str {
    match ty {
        "f64" | "f32" | "floating point" => "a number",
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number, 0 or more",
        "i8" | "i16" | "i32" | "i64" => "a whole number",
        "bool" | "boolean" | "a boolean" => "true or false",
        "sequence start" | "a sequence" => "a list",
        "mapping start" | "a map" => "a mapping of keys",
        "string scalar" | "a string" => "text",
        other if other.starts_with("struct ") => "a mapping of keys",
        other => other,
    }
}

/// The parser's words without the position, which is said before.
fn plain_syntax(error: &Yaml) -> String {
    let text = error.to_string();
    text.split(" at line ").next().unwrap_or(&text).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_keys_are_found() {
        assert!(is_near("tcp_sped_m_s", "tcp_speed_m_s"));
        assert!(is_near("square_m", "square_mm"));
        assert!(is_near("centre", "centre_mm"));
        assert!(!is_near("id", "at"));
        assert!(!is_near("board", "robot"));
    }

    #[test]
    fn a_mixed_up_unit_is_named() {
        let hint = |path, value, range| unit_hint(path, value, range).unwrap_or_default();
        assert_eq!(hint("a.xyz_m[0]", 400.0, [-10.0, 10.0]), ": is it in millimetres? this key takes metres");
        assert_eq!(hint("square_mm", 0.0088, [1.0, 1000.0]), ": is it in metres? this key takes millimetres");
        assert_eq!(hint("rotvec_rad[1]", 180.0, [-6.3, 6.3]), ": is it in degrees? this key takes radians");
        assert_eq!(hint("joint_speed_rad_s", 60.0, [0.01, 3.15]), ": is it in degrees? this key takes radians");
        assert_eq!(
            hint("tcp_speed_m_s", 250.0, [0.01, 1.0]),
            ": is it in millimetres per second? this key takes metres per second"
        );
        assert_eq!(hint("alpha", 3.0, [0.0, 1.0]), "");
    }
}
