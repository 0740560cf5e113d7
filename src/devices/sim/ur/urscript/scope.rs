//! Where variables live, and how many there may be.

use std::collections::HashMap;

use super::ast::Place;
use super::value::{Step, Value};

/// Values in all variables of a program; more is refused, so that memory stays bounded.
const MAX_STORED: usize = 200_000;

/// Values that a variable costs besides its own.
const OVERHEAD: usize = 4;

/// Variables of a program, a function or a thread.
#[derive(Debug, Default)]
pub(super) struct Scope {
    values: HashMap<String, Value>,
}

impl Scope {
    fn weight(&self) -> usize {
        self.values.values().map(|value| value.weight() + OVERHEAD).sum()
    }
}

/// The variables that all threads of a program share, and the account of those that they do not.
#[derive(Debug, Default)]
pub(super) struct Variables {
    global: Scope,
    /// Of the program itself: its functions and threads see them.
    main: Scope,
    stored: usize,
}

impl Variables {
    /// Value of a variable, so many steps inside; `None` where there is no such variable.
    pub(super) fn get(&self, local: Option<&Scope>, name: &str, path: &[Step]) -> Option<Result<Value, String>> {
        let found = local.and_then(|local| local.values.get(name).or_else(|| self.global.values.get(name)));
        let found = found.or_else(|| self.main.values.get(name)).or_else(|| self.global.values.get(name));
        found.map(|value| value.at(path))
    }

    /// Sets a variable: the nearest that there is, or a new one in the running function.
    pub(super) fn set(
        &mut self,
        local: Option<&mut Scope>,
        (place, name): (Place, &str),
        path: &[Step],
        value: Value,
    ) -> Result<(), String> {
        let Self { global, main, stored } = self;
        let is_local = local.as_ref().is_some_and(|l| l.values.contains_key(name));
        let chosen = match (place, local) {
            (Place::Global, _) => global,
            (Place::Local, Some(local)) => local,
            (Place::Local, None) => main,
            (Place::Nearest, Some(local)) if is_local => local,
            (Place::Nearest, Some(_)) if global.values.contains_key(name) => global,
            (Place::Nearest, Some(_)) if main.values.contains_key(name) => main,
            (Place::Nearest, Some(local)) => local,
            (Place::Nearest, None) if main.values.contains_key(name) || !global.values.contains_key(name) => main,
            (Place::Nearest, None) => global,
        };
        let slot = chosen.values.get_mut(name);
        let before = slot.as_ref().map_or(0, |value| value.weight() + OVERHEAD);
        let after = match slot {
            Some(slot) if !path.is_empty() => {
                let mut changed = slot.clone();
                changed.set(path, value)?;
                *slot = changed.checked()?;
                slot.weight()
            }
            None if !path.is_empty() => return Err(format!("`{name}` is not defined")),
            _ => {
                let weight = value.weight();
                chosen.values.insert(name.to_owned(), value);
                weight
            }
        };
        *stored = (*stored + after + OVERHEAD).saturating_sub(before);
        if *stored > MAX_STORED { Err("the variables of the program take too much memory".into()) } else { Ok(()) }
    }

    /// A function, or a thread, that was entered is left.
    pub(super) fn leave(&mut self, scope: &Scope) {
        self.stored = self.stored.saturating_sub(scope.weight());
    }
}
