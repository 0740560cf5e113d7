//! One RTDE client of the simulated controller.

use tokio::time::{Duration, Instant};

use super::body::Body;
use super::inputs::{self, ClientId};
use super::io;
use super::link::Link;
use super::network::{Kind, Network, Wire};
use super::outputs::{self, Snapshot, Source};
use crate::devices::rtde::{
    Answer, CodecError, ControllerVersion, DataType, FieldAnswer, Framer, PROTOCOL_VERSION, Recipe, Request, TextLevel,
    TextMessage, Value,
};

/// Cycles per second; the largest output rate.
const MAX_FREQUENCY_HZ: f64 = 500.0;

/// Input recipes per client.
const MAX_INPUT_RECIPES: usize = 255;

/// Bytes of names that a recipe may have, with the commas.
const MAX_NAMES_BYTES: usize = 2048;

/// Real time that a client which has answered one of several data packages has for each of the others; it may
/// pass over those that are late.
const PASS_OVER_AFTER: Duration = Duration::from_millis(5);

#[derive(Debug)]
struct Outputs {
    names: Vec<String>,
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
    pub(super) wire: Wire,
    framer: Framer,
    version_accepted: bool,
    outputs: Option<Outputs>,
    inputs: Vec<Inputs>,
    started: bool,
    /// Data packages that it has got and not answered.
    unanswered: usize,
    /// When it got the last of them, or answered the last time.
    unanswered_since: Instant,
    /// Whether it has answered since it got the last of them.
    has_answered: bool,
    /// Whether it has once been too slow for lock-step.
    lost_patience: bool,
}

impl RtdeClient {
    pub(super) fn new(id: ClientId, link: Link) -> Self {
        Self {
            id,
            wire: Wire::new(link, id),
            framer: Framer::default(),
            version_accepted: false,
            outputs: None,
            inputs: Vec::new(),
            started: false,
            unanswered: 0,
            unanswered_since: Instant::now(),
            has_answered: false,
            lost_patience: false,
        }
    }

    pub(super) fn is_started(&self) -> bool {
        self.started
    }

    pub(super) fn is_open(&self) -> bool {
        self.wire.link.is_open()
    }

    /// Whether simulated time keeps step with it: it gets outputs and has set up inputs.
    pub(super) fn drives(&self) -> bool {
        self.started && !self.inputs.is_empty() && !self.lost_patience && self.is_open()
    }

    /// Whether time stands until it answers a data package.
    pub(super) fn is_awaited(&self) -> bool {
        self.unanswered > 0 && self.drives() && !self.wire.owes_answer()
    }

    /// Until when time stands for it, unless it answers before.
    pub(super) fn awaited_until(&self, patience: Duration) -> Option<Instant> {
        let within = if self.has_answered { PASS_OVER_AFTER } else { patience };
        self.is_awaited().then(|| self.unanswered_since + within)
    }

    /// Lets time go on without its answer where it took too long; for good where it gave none at all.
    pub(super) fn expire(&mut self, now: Instant, patience: Duration) {
        if self.awaited_until(patience).is_some_and(|until| until <= now) {
            self.lost_patience |= !self.has_answered;
            self.unanswered = 0;
        }
    }

    /// Forgets what it has not answered: nothing reaches it any more.
    pub(super) fn forgive(&mut self) {
        self.unanswered = 0;
    }

    /// Sends what is due on a slow network.
    pub(super) fn deliver(&mut self, network: &Network) {
        self.wire.deliver(network);
        let sent = self.wire.take_sent();
        if sent > 0 && !network.is_silent() {
            self.unanswered += sent;
            (self.unanswered_since, self.has_answered) = (Instant::now(), false);
        }
    }

    /// Reads what has come and answers it.
    pub(super) fn serve(&mut self, body: &mut Body, network: &Network) {
        let mut bytes = Vec::new();
        self.wire.link.read(&mut bytes);
        let served = self.framer.push(&bytes).and_then(|()| self.serve_packages(body, network));
        if let Err(error) = served {
            self.text(TextLevel::Error, &format!("{error}; connection closed"), network);
            self.wire.link.close();
        }
    }

    fn serve_packages(&mut self, body: &mut Body, network: &Network) -> Result<(), CodecError> {
        while let Some(package) = self.framer.next_package()? {
            let answer = self.answer(Request::from_package(package)?, body, network);
            if let Some(answer) = answer {
                self.wire.send(&answer.to_bytes()?, Kind::Answer, network);
            }
        }
        Ok(())
    }

    fn answer(&mut self, request: Request, body: &mut Body, network: &Network) -> Option<Answer> {
        match request {
            Request::ProtocolVersion(version) => {
                self.version_accepted = version == PROTOCOL_VERSION && !network.refuses_protocol;
                Some(Answer::ProtocolVersion(self.version_accepted))
            }
            Request::ControllerVersion => {
                let [major, minor, bugfix, build] = body.config.version;
                Some(Answer::ControllerVersion(ControllerVersion { major, minor, bugfix, build }))
            }
            Request::SetupOutputs { frequency_hz, names } if self.may_set_up(&names) => {
                Some(self.set_up_outputs(frequency_hz, names, body, network))
            }
            Request::SetupInputs { names } if self.may_set_up(&names) => {
                Some(self.set_up_inputs(&names, body, network))
            }
            Request::SetupOutputs { .. } | Request::SetupInputs { .. } => {
                let needs = "set-up needs protocol version 2, paused outputs and at most 2048 bytes of names";
                self.text(TextLevel::Error, needs, network);
                None
            }
            Request::Start => {
                self.started = self.outputs.is_some() && !network.refuses_start;
                Some(Answer::Start(self.started))
            }
            Request::Pause => {
                (self.started, self.unanswered) = (false, 0);
                Some(Answer::Pause(true))
            }
            Request::Text(_) => None,
            Request::Data { recipe, body: values } => {
                self.take_inputs(recipe, &values, body, network);
                None
            }
        }
    }

    fn may_set_up(&self, names: &[String]) -> bool {
        let bytes = names.iter().map(|name| name.len() + 1).sum::<usize>();
        self.version_accepted && !self.started && bytes <= MAX_NAMES_BYTES + 1
    }

    fn set_up_outputs(&mut self, frequency_hz: f64, names: Vec<String>, body: &Body, network: &Network) -> Answer {
        let find = |name: &String| {
            let (data_type, source) = outputs::find(name, body).filter(|_| !network.is_missing(name))?;
            Some((if network.has_wrong_type(name) { other_than(data_type) } else { data_type }, source))
        };
        let found: Vec<_> = names.iter().map(find).collect();
        let fields = found.iter().map(|f| f.map_or(FieldAnswer::NotFound, |(t, _)| FieldAnswer::Typed(t))).collect();
        let all: Option<(Vec<DataType>, Vec<Source>)> = found.into_iter().collect::<Option<Vec<_>>>().map(unzip);
        let rate_allowed = (1.0..=MAX_FREQUENCY_HZ).contains(&frequency_hz);
        self.outputs = all.filter(|(types, _)| rate_allowed && !types.is_empty()).map(|(types, sources)| {
            let divider = (MAX_FREQUENCY_HZ / frequency_hz).floor() as u64;
            Outputs { names, recipe: Recipe { id: 1, types }, sources, divider: divider.max(1) }
        });
        Answer::SetupOutputs { recipe: u8::from(self.outputs.is_some()), fields }
    }

    fn set_up_inputs(&mut self, names: &[String], body: &mut Body, network: &Network) -> Answer {
        let offer = |name: &String| match body.inputs.offer(name, self.id) {
            _ if network.is_missing(name) => FieldAnswer::NotFound,
            FieldAnswer::Typed(_) if network.is_in_use(name) => FieldAnswer::InUse,
            FieldAnswer::Typed(t) if network.has_wrong_type(name) => FieldAnswer::Typed(other_than(t)),
            offered => offered,
        };
        let fields: Vec<_> = names.iter().map(offer).collect();
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

    fn take_inputs(&mut self, recipe: u8, values: &[u8], body: &mut Body, network: &Network) {
        let found = self.inputs.iter().find(|i| i.recipe.id == recipe);
        let decoded = found.map(|inputs| (inputs, inputs.recipe.decode(values)));
        match decoded {
            Some((inputs, Ok(values))) if values.iter().all(Value::is_finite) => {
                inputs.slots.iter().zip(&values).for_each(|(slot, value)| set_input(body, *slot, *value));
                io::apply(body, &inputs.slots);
                self.unanswered = self.unanswered.saturating_sub(1);
                (self.unanswered_since, self.has_answered) = (Instant::now(), true);
            }
            Some((_, Ok(_))) => self.text(TextLevel::Error, "input values are not finite, package ignored", network),
            Some((_, Err(error))) => self.text(TextLevel::Error, &error.to_string(), network),
            None => self.text(TextLevel::Error, &format!("input recipe {recipe} is not set up"), network),
        }
    }

    /// Whether a data package is due in this cycle.
    pub(super) fn is_due(&self, tick: u64) -> bool {
        self.started && self.outputs.as_ref().is_some_and(|o| tick.is_multiple_of(o.divider))
    }

    /// Sends a data package; while older ones are still unsent it is dropped, as on a real controller.
    pub(super) fn send_outputs(&mut self, body: &Body, snapshot: &Snapshot, network: &Network) {
        let Some(outputs) = &self.outputs else { return };
        if self.wire.link.is_congested() {
            return;
        }
        let fields = outputs.names.iter().zip(&outputs.recipe.types).zip(&outputs.sources);
        let value = |((name, data_type), source): ((&String, &DataType), &Source)| {
            let value = source.value(body, snapshot);
            let value = if network.is_not_a_number(name) { not_a_number(value) } else { value };
            if value.data_type() == *data_type { value } else { inputs::zero(*data_type) }
        };
        let values: Vec<_> = fields.map(value).collect();
        if let Ok(package) = outputs.recipe.encode(&values) {
            self.wire.send(&package, Kind::Data, network);
        }
    }

    pub(super) fn text(&mut self, level: TextLevel, message: &str, network: &Network) {
        self.send_text(&TextMessage { message: message.into(), source: "RTDE".into(), level }, network);
    }

    pub(super) fn send_text(&mut self, text: &TextMessage, network: &Network) {
        if let Ok(bytes) = Answer::Text(text.clone()).to_bytes() {
            self.wire.send(&bytes, Kind::Aside, network);
        }
    }
}

/// Takes a value that has the type of its input.
fn set_input(body: &mut Body, slot: usize, value: Value) {
    if body.inputs.data_type(slot) == Some(value.data_type()) {
        body.inputs.set(slot, value, body.tick);
    }
}

fn not_a_number(value: Value) -> Value {
    match value {
        Value::Double(_) => Value::Double(f64::NAN),
        Value::Vector3d(_) => Value::Vector3d([f64::NAN; 3]),
        Value::Vector6d(_) => Value::Vector6d([f64::NAN; 6]),
        whole => whole,
    }
}

/// A type that the field does not have.
fn other_than(data_type: DataType) -> DataType {
    if data_type == DataType::Double { DataType::Int32 } else { DataType::Double }
}

fn unzip(pairs: Vec<(DataType, Source)>) -> (Vec<DataType>, Vec<Source>) {
    pairs.into_iter().unzip()
}
