//! A program that runs: its threads, each a coroutine that is resumed once per controller cycle.

use std::cell::RefCell;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use super::machine::{Halt, Machine, Running};
use super::parser;
use super::shared::{MAIN, Shared};
use super::value::ThreadId;
use crate::devices::sim::ur::body::Body;

/// How a resumed program left its slice.
#[derive(Debug, PartialEq)]
pub(in super::super) enum Slice {
    /// It waits for the next cycle.
    Running,
    /// It came to its end.
    Ended,
    /// It was aborted, for this reason.
    Failed(String),
}

/// A program that runs.
pub(in super::super) struct Program {
    body: Rc<RefCell<Body>>,
    shared: Rc<RefCell<Shared>>,
    /// The program itself first, then its threads in the order of their start; empty after the end.
    threads: Vec<(ThreadId, Running<'static, ()>)>,
    secondary: bool,
}

impl Program {
    /// Reads a program text; the error says what is wrong and in which line.
    pub(in super::super) fn new(text: &str, body: Rc<RefCell<Body>>) -> Result<Self, String> {
        let upload = parser::upload(text)?;
        let shared = Rc::new(RefCell::new(Shared::new(upload.secondary)));
        let machine = Machine::new(MAIN, body.clone(), shared.clone());
        let main: Running<'static, ()> = Box::pin(async move { machine.run_main(&upload.main).await });
        Ok(Self { body, shared, threads: vec![(MAIN, main)], secondary: upload.secondary })
    }

    /// Whether it is a secondary program (`sec`): it runs at once, beside another one.
    pub(in super::super) fn is_secondary(&self) -> bool {
        self.secondary
    }

    /// Runs a secondary program to its end; the error says why it was aborted.
    pub(in super::super) fn run_at_once(&mut self) -> Result<(), String> {
        match self.resume() {
            Slice::Ended => Ok(()),
            Slice::Running => Err("a secondary program must not take time".into()),
            Slice::Failed(why) => Err(why),
        }
    }

    /// Runs every thread until it waits for the next cycle.
    pub(in super::super) fn resume(&mut self) -> Slice {
        if self.threads.is_empty() {
            return Slice::Ended;
        }
        self.shared.borrow_mut().begin_cycle();
        let mut next = 0;
        while let Some((id, coroutine)) = self.threads.get_mut(next) {
            let id = *id;
            if self.shared.borrow().may_run(id) {
                let polled = coroutine.as_mut().poll(&mut Context::from_waker(Waker::noop()));
                if let Poll::Ready(end) = polled
                    && let Some(slice) = self.ended(id, end)
                {
                    self.threads.clear();
                    return slice;
                }
                self.follow_threads();
            }
            // Numbers only grow; threads may have gone meanwhile.
            next = self.threads.partition_point(|(other, _)| *other <= id);
        }
        Slice::Running
    }

    /// What the end of a thread means for the program.
    fn ended(&mut self, id: ThreadId, end: Result<(), Halt>) -> Option<Slice> {
        self.shared.borrow_mut().end(id);
        match end {
            Ok(()) if id != MAIN => None,
            Ok(()) | Err(Halt::Asked) => Some(Slice::Ended),
            Err(Halt::Fault(why)) => Some(Slice::Failed(why)),
        }
    }

    /// Drops the threads that have ended or were killed, and takes in those that were started.
    fn follow_threads(&mut self) {
        let shared = self.shared.clone();
        self.threads.retain(|(id, _)| shared.borrow().is_alive(*id));
        let started = shared.borrow_mut().take_started();
        for start in started {
            let machine = Machine::new(start.id, self.body.clone(), self.shared.clone());
            let coroutine: Running<'static, ()> =
                Box::pin(async move { machine.run_thread(&start.function, start.arguments).await });
            self.threads.push((start.id, coroutine));
        }
    }
}
