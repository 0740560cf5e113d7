//! A small RTDE client that sees what is on the wire.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use crate::devices::rtde::{Answer, DataType, FieldAnswer, Framer, Package, Recipe, Request, Value};
use crate::devices::sim::ur::SimController;

/// The heartbeat of [`Raw::answer`].
pub(super) const INPUT: &str = "input_int_register_30";

pub(super) struct Raw {
    pub(super) stream: TcpStream,
    pub(super) framer: Framer,
    pub(super) outputs: Recipe,
    inputs: Recipe,
    beat: i32,
    /// Values have come that are not answered yet.
    unanswered: bool,
    /// Sizes of what single reads have given.
    pub(super) reads: Vec<usize>,
}

/// How a read ended without bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    Closed,
    Reset,
    Silent,
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|n| (*n).to_owned()).collect()
}

fn recipe(id: u8, fields: &[FieldAnswer]) -> Recipe {
    let typed = |f: &FieldAnswer| match f {
        FieldAnswer::Typed(data_type) => *data_type,
        other => panic!("{other:?}"),
    };
    Recipe { id, types: fields.iter().map(typed).collect() }
}

impl Raw {
    /// Connects, and says nothing.
    pub(super) fn open(sim: &SimController) -> Self {
        let stream = TcpStream::connect(SocketAddr::new(sim.address(), sim.ports().rtde)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        stream.set_nodelay(true).unwrap();
        let none = Recipe { id: 0, types: Vec::<DataType>::new() };
        Self {
            stream,
            framer: Framer::default(),
            outputs: none.clone(),
            inputs: none,
            beat: 0,
            unanswered: false,
            reads: Vec::new(),
        }
    }

    /// Connects and agrees on the protocol.
    pub(super) fn agreed(sim: &SimController) -> Self {
        let mut raw = Self::open(sim);
        assert_eq!(raw.ask(&Request::ProtocolVersion(2)), Answer::ProtocolVersion(true));
        raw
    }

    /// Connects, sets up the outputs and the heartbeat, and starts.
    pub(super) fn driving(sim: &SimController, frequency_hz: f64, outputs: &[&str]) -> Self {
        let mut raw = Self::agreed(sim);
        raw.outputs = raw.set_up_outputs(frequency_hz, outputs).unwrap();
        raw.inputs = raw.set_up_inputs(&[INPUT]).unwrap();
        assert_eq!(raw.ask(&Request::Start), Answer::Start(true));
        raw
    }

    pub(super) fn send(&mut self, request: &Request) {
        self.stream.write_all(&request.to_bytes().unwrap()).unwrap();
    }

    /// Asks, and passes over texts and data.
    pub(super) fn ask(&mut self, request: &Request) -> Answer {
        self.send(request);
        loop {
            match self.next() {
                Ok(Answer::Text(_) | Answer::Data { .. }) => {}
                Ok(answer) => return answer,
                Err(end) => panic!("{request:?}: {end:?}"),
            }
        }
    }

    /// The recipe, or the field answers where it is not valid.
    pub(super) fn set_up_outputs(&mut self, frequency_hz: f64, fields: &[&str]) -> Result<Recipe, Vec<FieldAnswer>> {
        match self.ask(&Request::SetupOutputs { frequency_hz, names: names(fields) }) {
            Answer::SetupOutputs { recipe: 0, fields } => Err(fields),
            Answer::SetupOutputs { recipe: id, fields } => Ok(recipe(id, &fields)),
            other => panic!("{other:?}"),
        }
    }

    pub(super) fn set_up_inputs(&mut self, fields: &[&str]) -> Result<Recipe, Vec<FieldAnswer>> {
        match self.ask(&Request::SetupInputs { names: names(fields) }) {
            Answer::SetupInputs { recipe: 0, fields } => Err(fields),
            Answer::SetupInputs { recipe: id, fields } => Ok(recipe(id, &fields)),
            other => panic!("{other:?}"),
        }
    }

    /// Reads once.
    fn read(&mut self) -> Result<Vec<u8>, End> {
        let mut bytes = [0; 8192];
        match self.stream.read(&mut bytes) {
            Ok(0) => Err(End::Closed),
            Ok(count) => {
                self.reads.push(count);
                Ok(bytes[..count].to_vec())
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => Err(End::Silent),
            Err(e) if e.kind() == ErrorKind::ConnectionReset => Err(End::Reset),
            Err(e) => panic!("{e}"),
        }
    }

    /// Reads until nothing comes for this time.
    pub(super) fn read_all(&mut self, silence: Duration) -> (Vec<u8>, End) {
        self.stream.set_read_timeout(Some(silence)).unwrap();
        let mut all = Vec::new();
        loop {
            match self.read() {
                Ok(bytes) => all.extend(bytes),
                Err(end) => return (all, end),
            }
        }
    }

    pub(super) fn next_package(&mut self) -> Result<Package, End> {
        loop {
            if let Some(package) = self.framer.next_package().unwrap() {
                return Ok(package);
            }
            let bytes = self.read()?;
            self.framer.push(&bytes).unwrap();
        }
    }

    pub(super) fn next(&mut self) -> Result<Answer, End> {
        self.next_package().map(|package| Answer::from_package(package).unwrap())
    }

    /// The next values; passes over texts.
    pub(super) fn values(&mut self) -> Result<Vec<Value>, End> {
        loop {
            match self.next()? {
                Answer::Data { body, .. } => {
                    self.unanswered = true;
                    return Ok(self.outputs.decode(&body).unwrap());
                }
                Answer::Text(_) => {}
                other => panic!("{other:?}"),
            }
        }
    }

    /// The first of the next values, a number.
    pub(super) fn number(&mut self) -> Result<f64, End> {
        match self.values()?.first() {
            Some(Value::Double(number)) => Ok(*number),
            other => panic!("{other:?}"),
        }
    }

    /// Answers a data package.
    pub(super) fn answer(&mut self) {
        (self.beat, self.unanswered) = (self.beat + 1, false);
        let values = self.inputs.types.iter().map(|_| Value::Int32(self.beat)).collect::<Vec<_>>();
        let bytes = self.inputs.encode(&values).unwrap();
        self.stream.write_all(&bytes).unwrap();
    }

    /// Answers the last values and those that follow until they are so; gives them.
    pub(super) fn turn_until(&mut self, done: impl Fn(&[Value]) -> bool) -> Vec<Value> {
        for _ in 0..20_000 {
            if self.unanswered {
                self.answer();
            }
            let values = self.values().unwrap();
            if done(&values) {
                return values;
            }
        }
        panic!("never came");
    }
}
