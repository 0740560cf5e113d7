//! What the threads of a program share: functions, variables, the critical section, the arm.

use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;

use super::ast::Function;
use super::scope::Variables;
use super::value::{ThreadId, Value};

/// The program itself.
pub(super) const MAIN: ThreadId = 0;

/// Steps of all threads in one cycle after which a program counts as an endless loop that never takes time.
const MAX_STEPS: usize = 50_000;

/// Threads at a time, with the program itself.
const MAX_THREADS: usize = 32;

/// A thread that was started and has not run yet.
pub(super) struct Start {
    pub(super) id: ThreadId,
    pub(super) function: Rc<Function>,
    pub(super) arguments: Vec<Value>,
}

pub(super) struct Shared {
    pub(super) functions: HashMap<String, Rc<Function>>,
    pub(super) threads: HashMap<String, Rc<Function>>,
    pub(super) variables: Variables,
    alive: BTreeSet<ThreadId>,
    started: Vec<Start>,
    /// Who is in the critical section.
    critical: Option<ThreadId>,
    /// Whose motion command the arm carries out.
    moving: Option<ThreadId>,
    steps: usize,
    last: ThreadId,
    /// Whether it is a secondary program: it may not move the arm.
    secondary: bool,
}

impl Default for Shared {
    fn default() -> Self {
        Self {
            functions: HashMap::new(),
            threads: HashMap::new(),
            variables: Variables::default(),
            alive: BTreeSet::from([MAIN]),
            started: Vec::new(),
            critical: None,
            moving: None,
            steps: 0,
            last: MAIN,
            secondary: false,
        }
    }
}

impl Shared {
    pub(super) fn new(secondary: bool) -> Self {
        Self { secondary, ..Self::default() }
    }

    pub(super) fn begin_cycle(&mut self) {
        self.steps = 0;
    }

    /// Counts work.
    pub(super) fn work(&mut self, steps: usize) -> Result<(), String> {
        self.steps = self.steps.saturating_add(steps);
        if self.steps > MAX_STEPS { Err("infinite loop: the program takes no time".into()) } else { Ok(()) }
    }

    pub(super) fn is_alive(&self, id: ThreadId) -> bool {
        self.alive.contains(&id)
    }

    /// Whether no other thread is in the critical section.
    pub(super) fn may_run(&self, id: ThreadId) -> bool {
        self.critical.is_none_or(|owner| owner == id)
    }

    pub(super) fn enter_critical(&mut self, id: ThreadId) {
        self.critical = Some(id);
    }

    pub(super) fn exit_critical(&mut self, id: ThreadId) {
        self.critical = self.critical.filter(|owner| *owner != id);
    }

    pub(super) fn start(&mut self, function: Rc<Function>, arguments: Vec<Value>) -> Result<ThreadId, String> {
        if self.alive.len() >= MAX_THREADS {
            return Err(format!("more than {MAX_THREADS} threads"));
        }
        self.last += 1;
        self.alive.insert(self.last);
        self.started.push(Start { id: self.last, function, arguments });
        Ok(self.last)
    }

    pub(super) fn take_started(&mut self) -> Vec<Start> {
        let mut started = std::mem::take(&mut self.started);
        started.retain(|start| self.alive.contains(&start.id));
        started
    }

    /// A thread has ended or is killed; true where its motion command is left unfinished.
    pub(super) fn end(&mut self, id: ThreadId) -> bool {
        self.alive.remove(&id);
        self.exit_critical(id);
        let was_moving = self.moving == Some(id);
        self.release_arm(id);
        was_moving
    }

    /// Lets a thread command the arm, unless another one does.
    pub(super) fn take_arm(&mut self, id: ThreadId) -> Result<(), String> {
        match self.moving {
            _ if self.secondary => Err("a secondary program must not move the robot".into()),
            Some(owner) if owner != id => Err("another thread is already controlling the robot".into()),
            _ => {
                self.moving = Some(id);
                Ok(())
            }
        }
    }

    pub(super) fn release_arm(&mut self, id: ThreadId) {
        self.moving = self.moving.filter(|owner| *owner != id);
    }
}
