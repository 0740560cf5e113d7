//! The evaluator: one machine per thread, written as a coroutine.

use std::cell::RefCell;
use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;
use std::task::Poll;

use super::ast::{Access, Argument, Binary, Block, Expr, Function, Kind, Place, Statement};
use super::builtins::{self, Bound, Call};
use super::scope::Scope;
use super::shared::{MAIN, Shared};
use super::value::{self, Step, ThreadId, Value};
use crate::devices::sim::ur::body::Body;

/// Calls, blocks and expressions inside each other.
const MAX_DEPTH: usize = 200;

/// Values that are copied in one step.
const VALUES_PER_STEP: usize = 50;

#[derive(Debug)]
pub(super) enum Halt {
    Asked,
    Fault(String),
}

impl From<String> for Halt {
    fn from(why: String) -> Self {
        Self::Fault(why)
    }
}

enum Flow {
    Next,
    Break,
    Continue,
    Return(Value),
}

pub(super) type Running<'a, T> = Pin<Box<dyn Future<Output = Result<T, Halt>> + 'a>>;

pub(super) struct Machine {
    id: ThreadId,
    body: Rc<RefCell<Body>>,
    shared: Rc<RefCell<Shared>>,
    /// Of the running functions; none in the program itself.
    scopes: Vec<Scope>,
    depth: usize,
}

impl Machine {
    pub(super) fn new(id: ThreadId, body: Rc<RefCell<Body>>, shared: Rc<RefCell<Shared>>) -> Self {
        Self { id, body, shared, scopes: Vec::new(), depth: 0 }
    }

    pub(super) async fn run_main(mut self, main: &Function) -> Result<(), Halt> {
        self.block(&main.body).await.map(|_| ())
    }

    pub(super) async fn run_thread(mut self, thread: &Function, arguments: Vec<Value>) -> Result<(), Halt> {
        let arguments = arguments.into_iter().map(Some).collect();
        self.call_user(thread, arguments).await.map(|_| ())
    }

    /// Counts work and nesting; the caller leaves with `self.depth -= 1`.
    fn enter(&mut self) -> Result<(), Halt> {
        self.shared.borrow_mut().work(1)?;
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(Halt::Fault("calls nested too deep".into()));
        }
        Ok(())
    }

    async fn next_cycle(&self) {
        let mut waited = false;
        std::future::poll_fn(|_| if std::mem::replace(&mut waited, true) { Poll::Ready(()) } else { Poll::Pending })
            .await;
    }

    fn block<'a>(&'a mut self, block: &'a Block) -> Running<'a, Flow> {
        Box::pin(async move {
            for statement in block {
                self.enter()?;
                if self.id == MAIN {
                    self.body.borrow_mut().script_line = statement.line as u32;
                }
                let flow = self.statement(statement).await.map_err(|halt| at_line(halt, statement.line))?;
                self.depth -= 1;
                if !matches!(flow, Flow::Next) {
                    return Ok(flow);
                }
            }
            Ok(Flow::Next)
        })
    }

    async fn statement(&mut self, statement: &Statement) -> Result<Flow, Halt> {
        match &statement.kind {
            Kind::Assign { place, name, path, value } => self.assign(*place, name, path, value).await?,
            Kind::Expr(value) => drop(self.eval(value).await?),
            Kind::If { branches, otherwise } => return self.branch(branches, otherwise).await,
            Kind::While { condition, body } => return self.repeat(condition, body).await,
            Kind::Return(None) => return Ok(Flow::Return(Value::Nothing)),
            Kind::Return(Some(value)) => return Ok(Flow::Return(self.eval(value).await?)),
            Kind::Break => return Ok(Flow::Break),
            Kind::Continue => return Ok(Flow::Continue),
            Kind::Pass => {}
            Kind::Halt => return Err(Halt::Asked),
            Kind::Def(function) => {
                drop(self.shared.borrow_mut().functions.insert(function.name.clone(), function.clone()));
            }
            Kind::Thread(function) => {
                drop(self.shared.borrow_mut().threads.insert(function.name.clone(), function.clone()));
            }
            Kind::Join(handle) => self.join(handle).await?,
            Kind::Kill(handle) => self.kill(handle).await?,
            Kind::EnterCritical => self.shared.borrow_mut().enter_critical(self.id),
            Kind::ExitCritical => self.shared.borrow_mut().exit_critical(self.id),
        }
        Ok(Flow::Next)
    }

    async fn branch(&mut self, branches: &[(Expr, Block)], otherwise: &Block) -> Result<Flow, Halt> {
        for (condition, block) in branches {
            if self.eval(condition).await?.truth()? {
                return self.block(block).await;
            }
        }
        self.block(otherwise).await
    }

    async fn repeat(&mut self, condition: &Expr, body: &Block) -> Result<Flow, Halt> {
        while self.eval(condition).await?.truth()? {
            match self.block(body).await? {
                Flow::Next | Flow::Continue => {}
                Flow::Break => break,
                Flow::Return(value) => return Ok(Flow::Return(value)),
            }
        }
        Ok(Flow::Next)
    }

    async fn join(&mut self, handle: &Expr) -> Result<(), Halt> {
        let Value::Thread(id) = self.eval(handle).await? else { return Ok(()) };
        if id == self.id {
            return Err(Halt::Fault("a thread waits for its own end".into()));
        }
        while self.shared.borrow().is_alive(id) {
            self.next_cycle().await;
        }
        Ok(())
    }

    /// Ends a thread; what is no thread, or has ended, is left alone.
    async fn kill(&mut self, handle: &Expr) -> Result<(), Halt> {
        let Value::Thread(id) = self.eval(handle).await? else { return Ok(()) };
        let unfinished = self.shared.borrow_mut().end(id);
        if unfinished {
            self.body.borrow_mut().leave_motion();
        }
        if id == self.id {
            self.next_cycle().await;
        }
        Ok(())
    }

    async fn assign(&mut self, place: Place, name: &str, path: &[Access], value: &Expr) -> Result<(), Halt> {
        let value = self.eval(value).await?;
        let steps = self.steps(path.iter()).await?;
        self.set(place, name, &steps, value)
    }

    fn set(&mut self, place: Place, name: &str, path: &[Step], value: Value) -> Result<(), Halt> {
        let mut shared = self.shared.borrow_mut();
        shared.work(value.weight() / VALUES_PER_STEP)?;
        Ok(shared.variables.set(self.scopes.last_mut(), (place, name), path, value)?)
    }

    async fn steps(&mut self, path: impl Iterator<Item = &Access>) -> Result<Vec<Step>, Halt> {
        let mut steps = Vec::new();
        for access in path {
            steps.push(match access {
                Access::Index(index) => Step::Index(self.eval(index).await?.index()?),
                Access::Member(name) => Step::Member(name.clone()),
            });
        }
        Ok(steps)
    }

    fn variable(&self, name: &str, path: &[Step]) -> Result<Value, Halt> {
        let mut shared = self.shared.borrow_mut();
        let found = shared.variables.get(self.scopes.last(), name, path);
        let value = found.ok_or_else(|| format!("`{name}` is not defined"))??;
        shared.work(value.weight() / VALUES_PER_STEP)?;
        Ok(value)
    }

    fn eval<'a>(&'a mut self, expr: &'a Expr) -> Running<'a, Value> {
        Box::pin(async move {
            self.enter()?;
            let value = self.eval_inside(expr).await?;
            self.depth -= 1;
            Ok(value)
        })
    }

    async fn eval_inside(&mut self, expr: &Expr) -> Result<Value, Halt> {
        Ok(match expr {
            Expr::Int(v) => Value::Int(*v),
            Expr::Float(v) => Value::Float(*v),
            Expr::Bool(v) => Value::Bool(*v),
            Expr::Text(v) => Value::Text(v.clone()).checked()?,
            Expr::Name(name) => self.variable(name, &[])?,
            Expr::List(items) => Value::List(self.all(items).await?).checked()?,
            Expr::Pose(items) => Value::Pose(value::six(&self.all(items).await?)?),
            Expr::Struct(members) => self.structure(members).await?,
            Expr::Unary(operator, inside) => value::unary(*operator, &self.eval(inside).await?)?,
            Expr::Binary(operator, left, right) => self.operate(*operator, left, right).await?,
            Expr::Part(..) => self.part(expr).await?,
            Expr::Call { name, arguments } => self.call(name, arguments).await?,
            Expr::Run { name, arguments } => self.start_thread(name, arguments).await?,
        })
    }

    async fn operate(&mut self, operator: Binary, left: &Expr, right: &Expr) -> Result<Value, Halt> {
        let left = self.eval(left).await?;
        // The right side is not looked at where the left one decides.
        match (operator, &left) {
            (Binary::And, Value::Bool(false)) | (Binary::Or, Value::Bool(true)) => return Ok(left),
            _ => {}
        }
        Ok(value::binary(operator, &left, &self.eval(right).await?)?)
    }

    /// Items that are not too large together.
    async fn all(&mut self, items: &[Expr]) -> Result<Vec<Value>, Halt> {
        let (mut values, mut weight) = (Vec::new(), 0);
        for item in items {
            let value = self.eval(item).await?;
            weight += value.weight();
            value::check_weight(weight)?;
            values.push(value);
        }
        Ok(values)
    }

    async fn structure(&mut self, members: &[(String, Expr)]) -> Result<Value, Halt> {
        let mut values = Vec::new();
        for (name, value) in members {
            values.push((name.clone(), self.eval(value).await?));
        }
        Ok(Value::Struct(values).checked()?)
    }

    /// An index or a member; only that is copied out of a variable.
    async fn part(&mut self, expr: &Expr) -> Result<Value, Halt> {
        let (mut inside, mut path) = (expr, Vec::new());
        while let Expr::Part(deeper, access) = inside {
            path.push(&**access);
            inside = deeper;
        }
        if let Expr::Name(name) = inside {
            let steps = self.steps(path.into_iter().rev()).await?;
            return self.variable(name, &steps);
        }
        let value = self.eval(inside).await?;
        let steps = self.steps(path.into_iter().rev()).await?;
        Ok(value.at(&steps)?)
    }

    async fn start_thread(&mut self, name: &str, arguments: &[Argument]) -> Result<Value, Halt> {
        let thread = self.shared.borrow().threads.get(name).cloned();
        let thread = thread.ok_or_else(|| format!("thread `{name}` is not known"))?;
        let names: Vec<&str> = thread.parameters.iter().map(String::as_str).collect();
        let mut values = Vec::new();
        for (value, name) in self.bind(arguments, &names).await?.into_iter().zip(names) {
            values.push(value.ok_or_else(|| format!("`{}` misses `{name}`", thread.name))?);
        }
        let id = self.shared.borrow_mut().start(thread.clone(), values)?;
        Ok(Value::Thread(id))
    }

    /// The values of arguments in the order of the parameters `names`.
    async fn bind(&mut self, arguments: &[Argument], names: &[&str]) -> Result<Bound, Halt> {
        let mut bound: Bound = vec![None; names.len()];
        for (position, argument) in arguments.iter().enumerate() {
            let wanted = argument.name.as_deref();
            let position = wanted.map_or(Some(position), |wanted| names.iter().position(|n| *n == wanted));
            let value = self.eval(&argument.value).await?;
            let slot = position.and_then(|p| bound.get_mut(p));
            *slot.ok_or_else(|| format!("arguments {names:?} are taken, not these"))? = Some(value);
        }
        Ok(bound)
    }

    async fn call(&mut self, name: &str, arguments: &[Argument]) -> Result<Value, Halt> {
        let function = self.shared.borrow().functions.get(name).cloned();
        if let Some(function) = function {
            let names: Vec<&str> = function.parameters.iter().map(String::as_str).collect();
            let bound = self.bind(arguments, &names).await?;
            return self.call_user(&function, bound).await;
        }
        let builtin = builtins::find(name)?;
        let bound = self.bind(arguments, builtin.parameters).await?;
        self.call_builtin(builtin, &bound).await
    }

    async fn call_user(&mut self, function: &Function, bound: Bound) -> Result<Value, Halt> {
        self.scopes.push(Scope::default());
        for (parameter, value) in function.parameters.iter().zip(bound) {
            let value = value.ok_or_else(|| format!("`{}` misses `{parameter}`", function.name))?;
            self.set(Place::Local, parameter, &[], value)?;
        }
        let flow = self.block(&function.body).await?;
        if let Some(scope) = self.scopes.pop() {
            self.shared.borrow_mut().variables.leave(&scope);
        }
        Ok(if let Flow::Return(value) = flow { value } else { Value::Nothing })
    }

    async fn call_builtin(&mut self, builtin: &builtins::Builtin, bound: &Bound) -> Result<Value, Halt> {
        if builtin.moves {
            self.take_arm(builtin).await?;
        }
        let call = builtins::call(builtin, &mut self.body.borrow_mut(), bound)?;
        let value = match call {
            Call::Done(value) => value.checked()?,
            Call::Ticks(ticks) => {
                for _ in 0..ticks {
                    self.next_cycle().await;
                }
                Value::Nothing
            }
            Call::UntilAtRest => {
                while self.body.borrow().motion.is_busy() {
                    self.next_cycle().await;
                }
                Value::Nothing
            }
            Call::UntilSpeedReached => {
                while !self.body.borrow().motion.has_reached_speed() {
                    self.next_cycle().await;
                }
                Value::Nothing
            }
        };
        if builtin.moves {
            self.shared.borrow_mut().release_arm(self.id);
        }
        Ok(value)
    }

    /// Waits until the arm takes this motion command: what was left of an earlier one ends first.
    async fn take_arm(&mut self, builtin: &builtins::Builtin) -> Result<(), Halt> {
        self.shared.borrow_mut().take_arm(self.id)?;
        while builtin.begins_at_rest && self.body.borrow().motion.is_busy() {
            self.body.borrow_mut().leave_motion();
            self.next_cycle().await;
        }
        Ok(())
    }
}

impl Drop for Machine {
    /// A killed thread leaves its functions unfinished.
    fn drop(&mut self) {
        if let Ok(mut shared) = self.shared.try_borrow_mut() {
            self.scopes.drain(..).for_each(|scope| shared.variables.leave(&scope));
        }
    }
}

fn at_line(halt: Halt, line: usize) -> Halt {
    match halt {
        // The innermost line is the one to name.
        Halt::Fault(why) if !why.starts_with("line ") => Halt::Fault(format!("line {line}: {why}")),
        other => other,
    }
}
