//! One RTDE client of the simulated controller.

use tokio::time::Instant;

use super::body::Body;
use super::inputs::ClientId;
use super::link::Link;
use super::outputs::{self, Snapshot, Source};
use crate::devices::rtde::{
    Answer, CodecError, ControllerVersion, DataType, FieldAnswer, Framer, PROTOCOL_VERSION, Recipe, Request, TextLevel,
    TextMessage, Value,
};

/// Cycles per second; the largest output rate.
const MAX_FREQUENCY_HZ: f64 = 500.0;

/// Input recipes per client.
const MAX_INPUT_RECIPES: usize = 255;

#[derive(Debug)]
struct Outputs {
    recipe: Recipe,
    sources: Vec<Source>,
    divider: u64,
}

#[derive(Debug)]
struct Inputs {
    recipe: Recipe,
    slots: Vec<usize>,
}

/// A client and what it has set up.
#[derive(Debug)]
pub(super) struct RtdeClient {
    pub(super) id: ClientId,
    pub(super) link: Link,
    framer: Framer,
    version_accepted: bool,
    outputs: Option<Outputs>,
    inputs: Vec<Inputs>,
    started: bool,
    /// Since when an answer to a data package is missing.
    awaiting_since: Option<Instant>,
    /// Whether it has once been too slow for lock-step.
    lost_patience: bool,
}

impl RtdeClient {
    pub(super) fn new(id: ClientId, link: Link) -> Self {
        Self {
            id,
            link,
            framer: Framer::default(),
            version_accepted: false,
            outputs: None,
            inputs: Vec::new(),
            started: false,
            awaiting_since: None,
            lost_patience: false,
        }
    }

    pub(super) fn is_started(&self) -> bool {
        self.started
    }

    /// Whether simulated time keeps step with it: it gets outputs and has set up inputs.
    pub(super) fn drives(&self) -> bool {
        self.started && !self.inputs.is_empty() && !self.lost_patience && self.link.is_open()
    }

    pub(super) fn awaiting_since(&self) -> Option<Instant> {
        self.awaiting_since.filter(|_| self.drives())
    }

    /// Time goes on without it from now on.
    pub(super) fn lose_patience(&mut self) {
        (self.lost_patience, self.awaiting_since) = (true, None);
    }

    /// Reads what has come and answers it.
    pub(super) fn serve(&mut self, body: &mut Body) {
        let mut bytes = Vec::new();
        self.link.read(&mut bytes);
        let served = self.framer.push(&bytes).and_then(|()| self.serve_packages(body));
        if let Err(error) = served {
            self.text(TextLevel::Error, &format!("{error}; connection closed"));
            self.link.close();
        }
    }

    fn serve_packages(&mut self, body: &mut Body) -> Result<(), CodecError> {
        while let Some(package) = self.framer.next_package()? {
            let answer = self.answer(Request::from_package(package)?, body);
            if let Some(answer) = answer {
                self.link.send(&answer.to_bytes()?);
            }
        }
        Ok(())
    }

    fn answer(&mut self, request: Request, body: &mut Body) -> Option<Answer> {
        match request {
            Request::ProtocolVersion(version) => {
                self.version_accepted = version == PROTOCOL_VERSION;
                Some(Answer::ProtocolVersion(self.version_accepted))
            }
            Request::ControllerVersion => {
                let [major, minor, bugfix, build] = body.config.version;
                Some(Answer::ControllerVersion(ControllerVersion { major, minor, bugfix, build }))
            }
            Request::SetupOutputs { frequency_hz, names } if self.may_set_up() => {
                Some(self.set_up_outputs(frequency_hz, &names, body))
            }
            Request::SetupInputs { names } if self.may_set_up() => Some(self.set_up_inputs(&names, body)),
            Request::SetupOutputs { .. } | Request::SetupInputs { .. } => {
                self.text(TextLevel::Error, "set-up needs protocol version 2 and paused outputs");
                None
            }
            Request::Start => {
                self.started = self.outputs.is_some();
                Some(Answer::Start(self.started))
            }
            Request::Pause => {
                (self.started, self.awaiting_since) = (false, None);
                Some(Answer::Pause(true))
            }
            Request::Text(_) => None,
            Request::Data { recipe, body: values } => {
                self.take_inputs(recipe, &values, body);
                None
            }
        }
    }

    fn may_set_up(&self) -> bool {
        self.version_accepted && !self.started
    }

    fn set_up_outputs(&mut self, frequency_hz: f64, names: &[String], body: &Body) -> Answer {
        let found: Vec<_> = names.iter().map(|name| outputs::find(name, body)).collect();
        let fields = found.iter().map(|f| f.map_or(FieldAnswer::NotFound, |(t, _)| FieldAnswer::Typed(t))).collect();
        let all: Option<(Vec<DataType>, Vec<Source>)> = found.into_iter().collect::<Option<Vec<_>>>().map(unzip);
        let rate_allowed = (1.0..=MAX_FREQUENCY_HZ).contains(&frequency_hz);
        self.outputs = all.filter(|(types, _)| rate_allowed && !types.is_empty()).map(|(types, sources)| {
            let divider = (MAX_FREQUENCY_HZ / frequency_hz).floor() as u64;
            Outputs { recipe: Recipe { id: 1, types }, sources, divider: divider.max(1) }
        });
        Answer::SetupOutputs { recipe: u8::from(self.outputs.is_some()), fields }
    }

    fn set_up_inputs(&mut self, names: &[String], body: &mut Body) -> Answer {
        let fields: Vec<_> = names.iter().map(|name| body.inputs.offer(name, self.id)).collect();
        let types: Option<Vec<_>> = fields
            .iter()
            .map(|f| match f {
                FieldAnswer::Typed(data_type) => Some(*data_type),
                FieldAnswer::NotFound | FieldAnswer::InUse => None,
            })
            .collect();
        let room = self.inputs.len() < MAX_INPUT_RECIPES && !names.is_empty();
        let Some(types) = types.filter(|_| room) else { return Answer::SetupInputs { recipe: 0, fields } };
        let slots: Vec<_> = names.iter().filter_map(|name| body.inputs.find(name)).collect();
        body.inputs.claim(&slots, self.id);
        let id = self.inputs.len() as u8 + 1;
        self.inputs.push(Inputs { recipe: Recipe { id, types }, slots });
        Answer::SetupInputs { recipe: id, fields }
    }

    fn take_inputs(&mut self, recipe: u8, values: &[u8], body: &mut Body) {
        let found = self.inputs.iter().find(|i| i.recipe.id == recipe);
        let decoded = found.map(|inputs| (inputs, inputs.recipe.decode(values)));
        match decoded {
            Some((inputs, Ok(values))) if values.iter().all(Value::is_finite) => {
                inputs.slots.iter().zip(&values).for_each(|(slot, value)| body.inputs.set(*slot, *value, body.tick));
                self.awaiting_since = None;
            }
            Some((_, Ok(_))) => self.text(TextLevel::Error, "input values are not finite, package ignored"),
            Some((_, Err(error))) => self.text(TextLevel::Error, &error.to_string()),
            None => self.text(TextLevel::Error, &format!("input recipe {recipe} is not set up")),
        }
    }

    /// Whether a data package is due in this cycle.
    pub(super) fn is_due(&self, tick: u64) -> bool {
        self.started && self.outputs.as_ref().is_some_and(|o| tick.is_multiple_of(o.divider))
    }

    /// Sends a data package; while older ones are still unsent it is dropped, as on a real controller.
    pub(super) fn send_outputs(&mut self, body: &Body, snapshot: &Snapshot) {
        let Some(outputs) = &self.outputs else { return };
        if self.link.is_congested() {
            return;
        }
        let values: Vec<_> = outputs.sources.iter().map(|s| s.value(body, snapshot)).collect();
        if let Ok(package) = outputs.recipe.encode(&values) {
            self.link.send(&package);
        }
        if self.drives() {
            self.awaiting_since = Some(Instant::now());
        }
    }

    pub(super) fn text(&mut self, level: TextLevel, message: &str) {
        self.send_text(&TextMessage { message: message.into(), source: "RTDE".into(), level });
    }

    pub(super) fn send_text(&mut self, text: &TextMessage) {
        if let Ok(bytes) = Answer::Text(text.clone()).to_bytes() {
            self.link.send(&bytes);
        }
    }
}

fn unzip(pairs: Vec<(DataType, Source)>) -> (Vec<DataType>, Vec<Source>) {
    pairs.into_iter().unzip()
}
