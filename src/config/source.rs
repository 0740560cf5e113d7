//! Where every key and value of a YAML text stands, by path (`segments[0].poses[2].xyz_mm[1]`).
//!
//! serde gives an error a position or a path, never both; this index gives the other half.

use std::fmt;

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_saphyr::Spanned;

/// Line and column, both from 1.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct At {
    pub(super) line: u64,
    pub(super) column: u64,
}

impl From<serde_saphyr::Location> for At {
    fn from(location: serde_saphyr::Location) -> Self {
        Self { line: location.line(), column: location.column() }
    }
}

/// One value of the text.
#[derive(Debug)]
pub(super) struct Entry {
    /// Keys and indices from the root; empty for the root.
    pub(super) path: String,
    /// Where its key stands; list items and the root have none.
    pub(super) key_at: Option<At>,
    /// Where the value stands.
    pub(super) at: At,
    /// The value as it is shown in a message.
    pub(super) shown: String,
    /// Whether it is NaN or infinite.
    pub(super) not_finite: bool,
}

/// Every value of a text, in the order of the text.
#[derive(Debug, Default)]
pub(super) struct Index {
    entries: Vec<Entry>,
}

impl Index {
    /// Reads any YAML.
    pub(super) fn of(text: &str) -> Result<Self, serde_saphyr::Error> {
        let options = serde_saphyr::options! {
            duplicate_keys: serde_saphyr::DuplicateKeyPolicy::PassThrough,
            non_finite_float_policy: serde_saphyr::NonFiniteFloatPolicy::PassThrough,
            with_snippet: false,
        };
        let mut entries = Vec::new();
        let root = serde_saphyr::from_str_with_options::<Spanned<Node>>(text, options)?;
        collect(root, String::new(), None, &mut entries);
        Ok(Self { entries })
    }

    /// The value at `path`, or the nearest one that contains it.
    pub(super) fn find(&self, path: &str) -> Option<&Entry> {
        let mut path = path;
        loop {
            if let Some(entry) = self.entries.iter().find(|e| e.path == path) {
                return Some(entry);
            }
            path = path.rfind(['.', '[']).map_or("", |end| &path[..end]);
            if path.is_empty() {
                return self.entries.first();
            }
        }
    }

    /// The value whose key or whose text starts at `at`; the innermost where several do.
    pub(super) fn at(&self, at: At) -> Option<&Entry> {
        let found = |e: &&Entry| e.at == at || e.key_at == Some(at);
        self.entries.iter().rev().find(found)
    }

    /// The values that are NaN or infinite.
    pub(super) fn not_finite(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter().filter(|e| e.not_finite)
    }
}

fn collect(node: Spanned<Node>, path: String, key_at: Option<At>, entries: &mut Vec<Entry>) {
    let at = At::from(node.referenced);
    let own = |shown: String, not_finite| Entry { path: path.clone(), key_at, at, shown, not_finite };
    match node.value {
        Node::Scalar { shown, not_finite } => entries.push(own(shown, not_finite)),
        Node::List(items) => {
            entries.push(own(format!("a list of {}", items.len()), false));
            for (i, item) in items.into_iter().enumerate() {
                collect(item, format!("{path}[{i}]"), None, entries);
            }
        }
        Node::Map(pairs) => {
            entries.push(own("a mapping of keys".into(), false));
            for (key, value) in pairs {
                collect(value, join(&path, &key.value), Some(At::from(key.referenced)), entries);
            }
        }
    }
}

/// `parent.key`, or `key` at the root.
pub(super) fn join(parent: &str, key: &str) -> String {
    if parent.is_empty() { key.to_owned() } else { format!("{parent}.{key}") }
}

enum Node {
    Scalar { shown: String, not_finite: bool },
    List(Vec<Spanned<Node>>),
    Map(Vec<(Spanned<String>, Spanned<Node>)>),
}

impl Node {
    fn scalar(shown: impl fmt::Display) -> Self {
        Self::Scalar { shown: shown.to_string(), not_finite: false }
    }
}

impl<'de> Deserialize<'de> for Node {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(NodeVisitor)
    }
}

struct NodeVisitor;

impl<'de> Visitor<'de> for NodeVisitor {
    type Value = Node;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any YAML")
    }

    fn visit_bool<E>(self, v: bool) -> Result<Node, E> {
        Ok(Node::scalar(v))
    }

    fn visit_i64<E>(self, v: i64) -> Result<Node, E> {
        Ok(Node::scalar(v))
    }

    fn visit_u64<E>(self, v: u64) -> Result<Node, E> {
        Ok(Node::scalar(v))
    }

    fn visit_f64<E>(self, v: f64) -> Result<Node, E> {
        Ok(Node::Scalar { shown: v.to_string(), not_finite: !v.is_finite() })
    }

    fn visit_str<E>(self, v: &str) -> Result<Node, E> {
        // A quoted ".nan" still becomes a number where one is wanted.
        let not_finite = v.trim().trim_start_matches(['+', '-', '.']).to_lowercase();
        let not_finite = matches!(not_finite.as_str(), "nan" | "inf" | "infinity");
        Ok(Node::Scalar { shown: format!("{v:?}"), not_finite })
    }

    fn visit_unit<E>(self) -> Result<Node, E> {
        Ok(Node::scalar("empty"))
    }

    fn visit_none<E>(self) -> Result<Node, E> {
        Ok(Node::scalar("empty"))
    }

    fn visit_some<D: Deserializer<'de>>(self, d: D) -> Result<Node, D::Error> {
        Node::deserialize(d)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Node, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element()? {
            items.push(item);
        }
        Ok(Node::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Node, A::Error> {
        let mut pairs = Vec::new();
        while let Some(pair) = map.next_entry()? {
            pairs.push(pair);
        }
        Ok(Node::Map(pairs))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_has_a_path_and_a_position() {
        let index = Index::of("a: 1\nb:\n  - {c: .nan}\n  - x\n").unwrap();
        let seen: Vec<_> = index.entries.iter().map(|e| (e.path.as_str(), e.at.line, e.at.column)).collect();
        assert_eq!(seen, [("", 1, 1), ("a", 1, 4), ("b", 3, 3), ("b[0]", 3, 5), ("b[0].c", 3, 9), ("b[1]", 4, 5)]);
        assert_eq!(index.not_finite().map(|e| e.path.as_str()).collect::<Vec<_>>(), ["b[0].c"]);
        assert_eq!(index.find("b[0].d.e").unwrap().path, "b[0]");
        assert_eq!(index.at(At { line: 3, column: 6 }).unwrap().path, "b[0].c");
    }

    #[test]
    fn no_yaml_has_no_index() {
        assert!(Index::of("a: [1").is_err());
    }
}
