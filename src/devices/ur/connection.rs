//! The RTDE connection: handshake, data packages in, input packages out.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio::runtime::Runtime;
use tokio::time::timeout;

use super::config::UrConfig;
use super::fields::OUTPUTS;
use crate::devices::RobotError;
use crate::devices::rtde::{
    Answer, CodecError, ControllerVersion, DataType, FieldAnswer, Framer, PROTOCOL_VERSION, Recipe, Request, TextLevel,
    TextMessage, Value,
};

/// Name and type of a field.
pub(super) type Field = (String, DataType);

/// Packages of unknown kinds that are passed over in one connection.
const MAX_UNKNOWN: usize = 1000;

/// Text messages kept for whoever asks.
const MAX_TEXTS: usize = 50;

/// The event loop of a driver.
pub(super) fn event_loop(config: &UrConfig) -> Result<Runtime, RobotError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    runtime.map_err(|e| RobotError::Unreachable {
        address: config.host.clone(),
        why: format!("the system gives no event loop: {e}"),
    })
}

/// Connects without delaying small packages.
pub(super) async fn open(address: &str, within: Duration) -> Result<TcpStream, RobotError> {
    let unreachable = |why: String| RobotError::Unreachable { address: address.into(), why };
    let stream = match timeout(within, TcpStream::connect(address)).await {
        Ok(stream) => stream.map_err(|e| unreachable(e.to_string()))?,
        Err(_) => return Err(unreachable(format!("no answer within {within:?}"))),
    };
    stream.set_nodelay(true).map_err(|e| unreachable(e.to_string()))?;
    Ok(stream)
}

pub(super) fn broken(address: &str, error: &std::io::Error) -> RobotError {
    RobotError::Broken { address: address.into(), why: error.to_string() }
}

/// A set-up RTDE connection.
#[derive(Debug)]
pub(super) struct Connection {
    address: String,
    stream: TcpStream,
    framer: Framer,
    texts: VecDeque<TextMessage>,
    exceptions: usize,
    unknown: usize,
    answer_within: Duration,
    version: ControllerVersion,
    outputs: Recipe,
    inputs: Recipe,
}

impl Connection {
    /// Connects and sets up the recipes: [`OUTPUTS`] and what is asked for beside them, and the inputs, if any.
    /// Outputs are not started yet.
    pub(super) async fn open(config: &UrConfig, extra: &[Field], inputs: &[Field]) -> Result<Self, RobotError> {
        let address = config.address(config.rtde_port);
        let stream = open(&address, config.answer_within).await?;
        let none = || Recipe { id: 0, types: Vec::new() };
        let mut connection = Self {
            address,
            stream,
            framer: Framer::default(),
            texts: VecDeque::new(),
            exceptions: 0,
            unknown: 0,
            answer_within: config.answer_within,
            version: ControllerVersion { major: 0, minor: 0, bugfix: 0, build: 0 },
            outputs: none(),
            inputs: none(),
        };
        connection.shake_hands(config, extra, inputs).await?;
        Ok(connection)
    }

    async fn shake_hands(&mut self, config: &UrConfig, extra: &[Field], inputs: &[Field]) -> Result<(), RobotError> {
        match self.ask(&Request::ProtocolVersion(PROTOCOL_VERSION)).await? {
            Answer::ProtocolVersion(true) => {}
            Answer::ProtocolVersion(false) => return Err(self.refused("protocol version 2", "it is too old")),
            other => return Err(self.unexpected(&other)),
        }
        match self.ask(&Request::ControllerVersion).await? {
            Answer::ControllerVersion(version) => self.version = version,
            other => return Err(self.unexpected(&other)),
        }
        let outputs: Vec<Field> = OUTPUTS.iter().map(|(name, t)| ((*name).to_owned(), *t)).collect();
        let outputs = [outputs.as_slice(), extra].concat();
        let names = |fields: &[Field]| fields.iter().map(|(name, _)| name.clone()).collect();
        match self.ask(&Request::SetupOutputs { frequency_hz: config.frequency_hz, names: names(&outputs) }).await? {
            Answer::SetupOutputs { recipe, fields } => self.outputs = self.recipe(recipe, &fields, &outputs)?,
            other => return Err(self.unexpected(&other)),
        }
        if inputs.is_empty() {
            return Ok(());
        }
        match self.ask(&Request::SetupInputs { names: names(inputs) }).await? {
            Answer::SetupInputs { recipe, fields } => self.inputs = self.recipe(recipe, &fields, inputs)?,
            other => return Err(self.unexpected(&other)),
        }
        Ok(())
    }

    /// The recipe, if every field has the type that is needed.
    fn recipe(&self, id: u8, fields: &[FieldAnswer], wanted: &[Field]) -> Result<Recipe, RobotError> {
        if fields.len() != wanted.len() {
            return Err(self.protocol(format!("{} field types for {} fields", fields.len(), wanted.len())));
        }
        let bad: Vec<_> = wanted.iter().zip(fields).filter(|((_, t), f)| **f != FieldAnswer::Typed(*t)).collect();
        if !bad.is_empty() {
            let said: Vec<_> = bad.iter().map(|((name, _), field)| format!("{name} is {}", field.name())).collect();
            let taken = bad.iter().any(|(_, field)| **field == FieldAnswer::InUse);
            let hint = if taken { "; another RTDE client or a fieldbus owns what is IN_USE" } else { "" };
            let why = format!("{}{hint}", said.join(", "));
            return Err(self.refused("RTDE fields", &why));
        }
        if id == 0 {
            return Err(self.refused("an RTDE recipe", "its number is 0"));
        }
        Ok(Recipe { id, types: wanted.iter().map(|(_, t)| *t).collect() })
    }

    /// Starts the outputs.
    pub(super) async fn start(&mut self) -> Result<(), RobotError> {
        match self.ask(&Request::Start).await? {
            Answer::Start(true) => Ok(()),
            Answer::Start(false) => Err(self.refused("the start of RTDE outputs", "it gives no reason")),
            other => Err(self.unexpected(&other)),
        }
    }

    pub(super) fn version(&self) -> ControllerVersion {
        self.version
    }

    /// Text messages of the controller since the last call.
    pub(super) fn take_texts(&mut self) -> Vec<TextMessage> {
        self.texts.drain(..).collect()
    }

    /// Number of exceptions that the controller has told of.
    pub(super) fn exceptions(&self) -> usize {
        self.exceptions
    }

    /// Sends a request and waits for the answer; texts and data that come before it are passed over.
    async fn ask(&mut self, request: &Request) -> Result<Answer, RobotError> {
        let bytes = request.to_bytes().map_err(|e| self.codec(&e))?;
        self.send(&bytes, self.answer_within).await?;
        let within = self.answer_within;
        match timeout(within, self.answer()).await {
            Ok(answer) => answer,
            Err(_) => Err(self.protocol(format!("no answer to {request:?} within {within:?}"))),
        }
    }

    async fn answer(&mut self) -> Result<Answer, RobotError> {
        loop {
            match self.next_waiting()? {
                Some(Answer::Data { .. }) => {}
                Some(answer) => return Ok(answer),
                None => self.read().await?,
            }
        }
    }

    /// The next thing said that is no text, out of what has been read already.
    fn next_waiting(&mut self) -> Result<Option<Answer>, RobotError> {
        while let Some(package) = self.framer.next_package().map_err(|e| self.codec(&e))? {
            let answer = match Answer::from_package(package) {
                // A later controller may say more than we know; a stream that is not RTDE says it all the time.
                Err(CodecError::Kind { .. }) if self.unknown < MAX_UNKNOWN => {
                    self.unknown += 1;
                    continue;
                }
                answer => answer.map_err(|e| self.codec(&e))?,
            };
            match answer {
                Answer::Text(text) => {
                    self.exceptions += usize::from(text.level == TextLevel::Exception);
                    self.texts.push_back(text);
                    if self.texts.len() > MAX_TEXTS {
                        self.texts.pop_front();
                    }
                }
                answer => return Ok(Some(answer)),
            }
        }
        Ok(None)
    }

    /// Values of the next data package, out of what has been read already.
    pub(super) fn next_values(&mut self) -> Result<Option<Vec<Value>>, RobotError> {
        match self.next_waiting()? {
            None => Ok(None),
            Some(Answer::Data { recipe, body }) if recipe == self.outputs.id => {
                self.outputs.decode(&body).map(Some).map_err(|e| self.codec(&e))
            }
            Some(other) => Err(self.unexpected(&other)),
        }
    }

    /// Reads what has come, and waits for it.
    pub(super) async fn read(&mut self) -> Result<(), RobotError> {
        let mut bytes = [0; 8192];
        match self.stream.read(&mut bytes).await {
            Ok(0) => {
                let why = "the controller closed it; did it restart, or does another client use RTDE?".into();
                Err(RobotError::Broken { address: self.address.clone(), why })
            }
            Ok(count) => self.framer.push(&bytes[..count]).map_err(|e| self.codec(&e)),
            Err(error) => Err(broken(&self.address, &error)),
        }
    }

    /// Sends one package of the input recipe.
    pub(super) async fn send_inputs(&mut self, values: &[Value], within: Duration) -> Result<(), RobotError> {
        let bytes = self.inputs.encode(values).map_err(|e| self.codec(&e))?;
        self.send(&bytes, within).await
    }

    async fn send(&mut self, bytes: &Bytes, within: Duration) -> Result<(), RobotError> {
        match timeout(within, self.stream.write_all(bytes)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(error)) => Err(broken(&self.address, &error)),
            Err(_) => Err(broken(&self.address, &std::io::ErrorKind::TimedOut.into())),
        }
    }

    pub(super) fn protocol(&self, what: String) -> RobotError {
        RobotError::Protocol { address: self.address.clone(), what }
    }

    fn codec(&self, error: &CodecError) -> RobotError {
        self.protocol(error.to_string())
    }

    fn unexpected(&self, answer: &Answer) -> RobotError {
        self.protocol(format!("unexpected {answer:?}"))
    }

    /// What the controller refused, with the last thing that it said.
    pub(super) fn refused(&self, what: &str, why: &str) -> RobotError {
        let said = self.texts.back().map_or_else(String::new, |t| format!("; it says: {}", t.message));
        RobotError::Refused { what: what.into(), why: format!("{why}{said}") }
    }
}
