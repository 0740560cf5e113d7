//! Runs a program: an evaluator written as a coroutine that is resumed once per controller cycle.

use std::cell::RefCell;
use std::collections::HashMap;
use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use super::ast::{Argument, Binary, Block, Expr, Function, Kind, Place, Statement};
use super::value::{self, Value};
use super::{builtins, parser};
use crate::devices::sim::ur::body::Body;

/// Steps in one cycle after which a program counts as an endless loop that never takes time.
const MAX_STEPS: usize = 50_000;

/// Calls, blocks and expressions inside each other.
const MAX_DEPTH: usize = 200;

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
    /// `None` after its end.
    coroutine: Option<Running<'static, ()>>,
}

impl Program {
    /// Reads a program text; the error says what is wrong and in which line.
    pub(in super::super) fn new(text: &str, body: Rc<RefCell<Body>>) -> Result<Self, String> {
        let main = parser::program(text)?;
        let coroutine: Running<'static, ()> = Box::pin(async move { Machine::new(body).run(&main).await });
        Ok(Self { coroutine: Some(coroutine) })
    }

    /// Runs until the program waits for the next cycle.
    pub(in super::super) fn resume(&mut self) -> Slice {
        let Some(coroutine) = &mut self.coroutine else { return Slice::Ended };
        let Poll::Ready(end) = coroutine.as_mut().poll(&mut Context::from_waker(Waker::noop())) else {
            return Slice::Running;
        };
        self.coroutine = None;
        match end {
            Ok(()) | Err(Halt::Asked) => Slice::Ended,
            Err(Halt::Fault(why)) => Slice::Failed(why),
        }
    }
}

#[derive(Debug)]
enum Halt {
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

type Running<'a, T> = Pin<Box<dyn Future<Output = Result<T, Halt>> + 'a>>;

struct Machine {
    body: Rc<RefCell<Body>>,
    functions: HashMap<String, Rc<Function>>,
    globals: HashMap<String, Value>,
    /// The first belongs to the program, the last to the running function.
    scopes: Vec<HashMap<String, Value>>,
    steps: usize,
    depth: usize,
}

impl Machine {
    fn new(body: Rc<RefCell<Body>>) -> Self {
        let (functions, globals) = (HashMap::new(), HashMap::new());
        Self { body, functions, globals, scopes: vec![HashMap::new()], steps: 0, depth: 0 }
    }

    async fn run(&mut self, main: &Function) -> Result<(), Halt> {
        self.block(&main.body).await.map(|_| ())
    }

    /// Counts work and nesting; the caller leaves with `self.depth -= 1`.
    fn enter(&mut self) -> Result<(), Halt> {
        self.steps += 1;
        self.depth += 1;
        if self.steps > MAX_STEPS {
            return Err(Halt::Fault("infinite loop: the program takes no time".into()));
        }
        if self.depth > MAX_DEPTH {
            return Err(Halt::Fault("calls nested too deep".into()));
        }
        Ok(())
    }

    async fn next_cycle(&mut self) {
        let mut waited = false;
        std::future::poll_fn(|_| if std::mem::replace(&mut waited, true) { Poll::Ready(()) } else { Poll::Pending })
            .await;
        self.steps = 0;
    }

    fn block<'a>(&'a mut self, block: &'a Block) -> Running<'a, Flow> {
        Box::pin(async move {
            for statement in block {
                self.enter()?;
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
            Kind::Assign { place, name, index, value } => self.assign(*place, name, index.as_ref(), value).await?,
            Kind::Expr(value) => drop(self.eval(value).await?),
            Kind::If { branches, otherwise } => return self.branch(branches, otherwise).await,
            Kind::While { condition, body } => return self.repeat(condition, body).await,
            Kind::Return(None) => return Ok(Flow::Return(Value::Nothing)),
            Kind::Return(Some(value)) => return Ok(Flow::Return(self.eval(value).await?)),
            Kind::Break => return Ok(Flow::Break),
            Kind::Continue => return Ok(Flow::Continue),
            Kind::Pass => {}
            Kind::Halt => return Err(Halt::Asked),
            Kind::Def(function) => drop(self.functions.insert(function.name.clone(), function.clone())),
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

    async fn assign(&mut self, place: Place, name: &str, index: Option<&Expr>, value: &Expr) -> Result<(), Halt> {
        let value = self.eval(value).await?;
        if let Some(index) = index {
            let index = self.eval(index).await?.index()?;
            let list = self.variable(name).ok_or_else(|| format!("`{name}` is not defined"))?;
            return Ok(list.set_item(index, value)?);
        }
        match (place, self.variable(name)) {
            (Place::Global, _) => drop(self.globals.insert(name.to_owned(), value)),
            (Place::Nearest, Some(variable)) => *variable = value,
            (Place::Nearest | Place::Local, _) => {
                if let Some(scope) = self.scopes.last_mut() {
                    scope.insert(name.to_owned(), value);
                }
            }
        }
        Ok(())
    }

    /// In the running function, else global, else of the program around it.
    fn variable(&mut self, name: &str) -> Option<&mut Value> {
        let (last, outer) = self.scopes.split_last_mut()?;
        if let Some(found) = last.get_mut(name) {
            return Some(found);
        }
        if let Some(found) = self.globals.get_mut(name) {
            return Some(found);
        }
        outer.first_mut()?.get_mut(name)
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
            Expr::Text(v) => Value::Text(v.clone()),
            Expr::Name(name) => self.variable(name).cloned().ok_or_else(|| format!("`{name}` is not defined"))?,
            Expr::List(items) => Value::List(self.all(items).await?),
            Expr::Pose(items) => Value::Pose(value::six(&self.all(items).await?)?),
            Expr::Unary(operator, inside) => value::unary(*operator, &self.eval(inside).await?)?,
            Expr::Binary(operator, left, right) => self.operate(*operator, left, right).await?,
            Expr::Index(list, index) => {
                let list = self.eval(list).await?;
                list.item(self.eval(index).await?.index()?)?
            }
            Expr::Call { name, arguments } => self.call(name, arguments).await?,
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

    async fn all(&mut self, items: &[Expr]) -> Result<Vec<Value>, Halt> {
        let mut values = Vec::with_capacity(items.len());
        for item in items {
            values.push(self.eval(item).await?);
        }
        Ok(values)
    }

    async fn call(&mut self, name: &str, arguments: &[Argument]) -> Result<Value, Halt> {
        let function = self.functions.get(name).cloned();
        let names: Vec<&str> = match &function {
            Some(function) => function.parameters.iter().map(String::as_str).collect(),
            None => builtins::parameters(name).ok_or_else(|| format!("function `{name}` is not known"))?.to_vec(),
        };
        let mut bound: Vec<Option<Value>> = vec![None; names.len()];
        for (position, argument) in arguments.iter().enumerate() {
            let wanted = argument.name.as_deref();
            let position = wanted.map_or(Some(position), |wanted| names.iter().position(|n| *n == wanted));
            let value = self.eval(&argument.value).await?;
            let slot = position.and_then(|p| bound.get_mut(p));
            *slot.ok_or_else(|| format!("`{name}` takes {names:?}"))? = Some(value);
        }
        match &function {
            Some(function) => self.call_user(function, bound).await,
            None => self.call_builtin(name, &bound).await,
        }
    }

    async fn call_user(&mut self, function: &Function, bound: Vec<Option<Value>>) -> Result<Value, Halt> {
        let mut scope = HashMap::new();
        for (parameter, value) in function.parameters.iter().zip(bound) {
            let value = value.ok_or_else(|| format!("`{}` misses `{parameter}`", function.name))?;
            scope.insert(parameter.clone(), value);
        }
        self.scopes.push(scope);
        let flow = self.block(&function.body).await?;
        self.scopes.pop();
        Ok(if let Flow::Return(value) = flow { value } else { Value::Nothing })
    }

    async fn call_builtin(&mut self, name: &str, bound: &[Option<Value>]) -> Result<Value, Halt> {
        let call = builtins::call(&mut self.body.borrow_mut(), name, bound)?;
        match call {
            builtins::Call::Done(value) => return Ok(value),
            builtins::Call::Ticks(ticks) => {
                for _ in 0..ticks {
                    self.next_cycle().await;
                }
            }
            builtins::Call::UntilAtRest => {
                while self.body.borrow().motion.is_busy() {
                    self.next_cycle().await;
                }
            }
        }
        Ok(Value::Nothing)
    }
}

fn at_line(halt: Halt, line: usize) -> Halt {
    match halt {
        // The innermost line is the one to name.
        Halt::Fault(why) if !why.starts_with("line ") => Halt::Fault(format!("line {line}: {why}")),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::devices::sim::ur::config::{Flaws, Individual, SimUrConfig};

    fn body() -> Rc<RefCell<Body>> {
        let config = SimUrConfig { flaws: Flaws::none(), ..SimUrConfig::default() };
        Rc::new(RefCell::new(Body::new(&config, &Individual::draw(&config, 1), 1)))
    }

    /// Runs to the end, at most 10 s, and gives the slices used and the end.
    fn run(text: &str, body: &Rc<RefCell<Body>>) -> (usize, Slice) {
        let mut program = match Program::new(text, body.clone()) {
            Ok(program) => program,
            Err(why) => return (0, Slice::Failed(why)),
        };
        for slice in 0..5000 {
            match program.resume() {
                Slice::Running => body.borrow_mut().tick_drives(),
                end => return (slice, end),
            }
        }
        (5000, Slice::Running)
    }

    fn register_0(body: &Rc<RefCell<Body>>, text: &str) -> f64 {
        let (_, end) = run(text, body);
        assert_eq!(end, Slice::Ended, "{text}");
        body.borrow().output_double[0]
    }

    #[test]
    fn the_language() {
        for (statements, known) in [
            ("x = 1 + 2 * 3 - 4 / 8 write_output_float_register(0, x)", 6.5),
            ("a = [1, 2, 3]\n a[1] = 5 write_output_float_register(0, a[1] % 3)", 2.0),
            ("def f(a, b):\n return a - b\n end\n write_output_float_register(0, f(b=2, a=9))", 7.0),
            ("global x =\n 4\n y = -x\n write_output_float_register(0, y)", -4.0),
            ("i = 0 while (i < 10): i = i + 1 if i == 7: break end end write_output_float_register(0, i)", 7.0),
            ("p1 = p[1, 2, 2, 0, 0, 0] write_output_float_register(0, norm(p1))", 3.0),
            (
                "x = 3\n if x > 5:\n y = 1\n elif not x == 3:\n y = 2\n else:\n y = 3\n end\n write_output_float_register(0, y)",
                3.0,
            ),
            ("x = False and undefined or True # comment \"\n if x: write_output_float_register(0, 1.5e-1) end", 0.15),
            ("def f():\n x = 5\n end\n x = 1\n f()\n write_output_float_register(0, x)", 5.0),
            ("def f():\n local x = 5\n end\n x = 1\n f()\n write_output_float_register(0, x)", 1.0),
            (
                "def f(n):\n if n < 2: return 1 end\n return n * f(n - 1)\n end\n write_output_float_register(0, f(5))",
                120.0,
            ),
        ] {
            assert_eq!(register_0(&body(), &format!("def prog():\n{statements}\nend\n")), known, "{statements}");
        }
    }

    #[test]
    fn time_passes_only_where_it_should() {
        let body = body();
        assert_eq!(run("def p():\n sync()\n sleep(0.1)\n sync()\nend\n", &body), (52, Slice::Ended));
        assert_eq!(run("textmsg(\"one line\")\n", &body), (0, Slice::Ended));
    }

    #[test]
    fn faults_say_what_and_where() {
        for (text, why) in [
            ("def p():\n\n nonsense(1)\nend", "line 3: function `nonsense` is not known"),
            ("def p():\n x = y\nend", "line 2: `y` is not defined"),
            ("def p():\n while True:\n end\nend", "line 2: infinite loop: the program takes no time"),
            ("def f():\n f()\nend\nf()", "calls nested too deep"),
            ("def p():\n if True:\nend", "expected `end`"),
            ("def p():\n x = [1][3]\nend", "line 2: index 3 is out of range"),
            ("def p():\n movej([0, 0, 0], 1, 1)\nend", "3 numbers where six are needed"),
            ("def p():\n movej([0, 0, 0, 0, 0, 99], 1, 1)\nend", "outside"),
            ("x = 1 $ 2", "`$` begins no word"),
        ] {
            let (_, end) = run(text, &body());
            assert!(matches!(&end, Slice::Failed(found) if found.contains(why)), "{text}: {end:?}, not {why}");
        }
        let brackets = format!("x = {}1{}", "(".repeat(5000), ")".repeat(5000));
        for deep in [brackets, format!("x = 1{}", "+1".repeat(200_000)), "if True: ".repeat(5000), "-".repeat(5000)] {
            assert!(matches!(run(&deep, &body()).1, Slice::Failed(_)));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn no_text_panics(picks in prop::collection::vec(0..WORDS.len(), 0..60)) {
            let text: String = picks.iter().map(|i| WORDS[*i]).collect();
            if let Ok(mut program) = Program::new(&text, body()) {
                (0..3).for_each(|_| drop(program.resume()));
            }
        }
    }

    const WORDS: [&str; 40] = [
        "def ", "f", "(", ")", ":", "end ", "\n", "if ", "elif ", "else:", "while ", "return ", "x", " = ", "1", "2.5",
        "\"s\"", "[", "]", ",", "p[", "+", "-", "*", "/ ", "% ", "not ", "and ", "or ", "==", "<", "True ", "global ",
        "sync()", "movej(", "norm(", "sleep(", "#", "é", ".",
    ];

    #[test]
    fn moves_block_until_the_arm_is_there() {
        let body = body();
        let text = "def p():\n q = get_actual_joint_positions()\n q[0] = q[0] + 0.5\n movej(q, a=2.0, v=1.0)\n\
                    t = get_actual_tcp_pose()\n t[2] = t[2] + 0.1\n movel(t, 0.5, 0.25)\nend\n";
        let before = body.borrow().motion.target();
        let (slices, end) = run(text, &body);
        assert_eq!(end, Slice::Ended);
        // 1 s for 0.5 rad, 0.9 s for 0.1 m.
        assert!((900..960).contains(&slices), "{slices}");
        let after = body.borrow().motion.target();
        assert!((after[0] - before[0] - 0.5).abs() < 1e-6);
    }

    #[test]
    fn the_executor_script_is_understood() {
        let body = body();
        body.borrow_mut().runtime = crate::devices::sim::ur::body::Runtime::Playing;
        let mut program = Program::new(crate::devices::ur::MOTION_SCRIPT, body.clone()).unwrap();
        for _ in 0..20 {
            assert_eq!(program.resume(), Slice::Running);
        }
        assert_eq!(body.borrow().output_int[25], 1);
    }
}
