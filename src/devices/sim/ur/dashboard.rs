//! The answers of the dashboard server, in PolyScope 5 words.
//!
//! A loaded program has no text here: played, it waits until it is stopped. In local control the
//! commands that act are refused. `shutdown` is refused: the simulator ends with its owner.

use super::body::{Body, Runtime};
use super::link::Link;
use super::outputs;
use super::panel::{self, OperationalMode};

/// Longest line of a client; a longer one closes the connection.
const MAX_LINE_BYTES: usize = 1024;

/// What greets a new client.
pub(super) const GREETING: &[u8] = b"Connected: Universal Robots Dashboard Server\n";

/// What a loaded program does.
const LOADED_PROGRAM: &str = "def loaded():\n while True:\n sync()\n end\nend\n";

const TOO_EARLY: &str = "Cannot unlock protective stop until 5s after occurrence. \
                         Always inspect cause of protective stop before unlocking";

/// What a line asks of the program, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wish {
    Stop,
    /// Runs this text.
    Play(&'static str),
}

/// One client of the dashboard.
#[derive(Debug)]
pub(super) struct DashboardClient {
    pub(super) link: Link,
    line: Vec<u8>,
}

impl DashboardClient {
    pub(super) fn new(mut link: Link) -> Self {
        link.send(GREETING);
        Self { link, line: Vec::new() }
    }

    /// Answers the lines that have come, and gives what they ask of the program.
    pub(super) fn serve(&mut self, body: &mut Body) -> Vec<Wish> {
        let mut bytes = Vec::new();
        self.link.read(&mut bytes);
        let mut wishes = Vec::new();
        for byte in bytes {
            if byte == b'\n' {
                let line = String::from_utf8_lossy(&std::mem::take(&mut self.line)).trim().to_owned();
                let (reply, wish) = answer(&line, body);
                wishes.extend(wish);
                self.link.send(format!("{reply}\n").as_bytes());
                if line == "quit" {
                    self.link.close();
                }
            } else if self.line.len() < MAX_LINE_BYTES {
                self.line.push(byte);
            } else {
                self.link.close();
            }
        }
        wishes
    }
}

/// Commands with which a client acts on the robot, by their first word or words.
const ACTING: [&str; 9] = [
    "load",
    "play",
    "stop",
    "pause",
    "power on",
    "power off",
    "brake release",
    "unlock protective stop",
    "restart safety",
];

fn answer(line: &str, body: &mut Body) -> (String, Option<Wish>) {
    if body.dashboard_refuses {
        return (format!("Failed to execute: {line}"), None);
    }
    let acts = |command: &&str| line.strip_prefix(*command).is_some_and(|r| r.is_empty() || r.starts_with(' '));
    if !body.config.remote_control && ACTING.iter().any(acts) {
        return ("Command is not allowed due to safety reasons".into(), None);
    }
    match line {
        "play" => play(body),
        "stop" => ("Stopped".into(), Some(Wish::Stop)),
        "power off" => {
            panel::power_off(body);
            ("Powering off".into(), Some(Wish::Stop))
        }
        _ => (asked(line, body).or_else(|| acted(line, body)).unwrap_or_else(|| with_argument(line, body)), None),
    }
}

fn play(body: &mut Body) -> (String, Option<Wish>) {
    let started = "Starting program".to_owned();
    if body.runtime == Runtime::Playing || panel::go_on(body) {
        return (started, None);
    }
    let ready = body.runtime == Runtime::Stopped && body.may_run() && body.panel.loaded.is_some();
    if ready { (started, Some(Wish::Play(LOADED_PROGRAM))) } else { ("Failed to execute: play".into(), None) }
}

/// Questions, which change nothing.
fn asked(line: &str, body: &Body) -> Option<String> {
    let [major, minor, bugfix, build] = body.config.version;
    Some(match line {
        "robotmode" => format!("Robotmode: {}", robot_mode(body)),
        "safetystatus" => format!("Safetystatus: {}", body.safety.name()),
        "safetymode" => format!("Safetymode: {}", body.safety.name()),
        "PolyscopeVersion" => format!("URSoftware {major}.{minor}.{bugfix}.{build} (Oct 26 2022)"),
        "version" => format!("{major}.{minor}.{bugfix}.{build}"),
        "is in remote control" => body.config.remote_control.to_string(),
        "get serial number" => body.config.serial.clone(),
        "get robot model" => body.config.model.clone(),
        "programState" => format!("{} {}", program_state(body), panel::program_name(body)),
        "running" => format!("Program running: {}", body.runtime == Runtime::Playing),
        "get loaded program" => match &body.panel.loaded {
            Some(name) => format!("Loaded program: /programs/{name}"),
            None => "No program loaded".into(),
        },
        "isProgramSaved" => format!("{} {}", body.panel.loaded.is_some(), panel::program_name(body)),
        "get operational mode" => body.panel.mode.word().into(),
        _ => return None,
    })
}

/// Commands without an argument.
fn acted(line: &str, body: &mut Body) -> Option<String> {
    Some(match line {
        "pause" if body.runtime == Runtime::Playing => {
            body.pause_program();
            "Pausing program".into()
        }
        "pause" => "Failed to execute: pause".into(),
        "power on" => {
            panel::power_on(body);
            "Powering on".into()
        }
        "brake release" => {
            panel::release_brakes(body);
            "Brake releasing".into()
        }
        "unlock protective stop" => if panel::unlock(body) { "Protective stop releasing" } else { TOO_EARLY }.into(),
        "restart safety" => "Restarting safety".into(),
        "close safety popup" => "closing safety popup".into(),
        "close popup" => {
            body.panel.popup = None;
            "closing popup".into()
        }
        "clear operational mode" => {
            body.panel.mode = OperationalMode::None;
            "No longer controlling the operational mode. Current operational mode: 'NONE'.".into()
        }
        "quit" => "Disconnected".into(),
        "shutdown" => "Failed to execute: shutdown".into(),
        _ => return None,
    })
}

fn with_argument(line: &str, body: &mut Body) -> String {
    let argument = |command: &str| line.strip_prefix(command).and_then(|rest| rest.strip_prefix(' ')).map(str::trim);
    if let Some(name) = argument("load installation") {
        return format!("File not found: /programs/{name}");
    }
    if let Some(name) = argument("load") {
        let name = name.trim_start_matches("/programs/");
        let stopped = body.runtime == Runtime::Stopped;
        return match stopped && panel::load(body, name) {
            true => format!("Loading program: /programs/{name}"),
            false if stopped => format!("File not found: /programs/{name}"),
            false => format!("Error while loading program: /programs/{name}"),
        };
    }
    if let Some(text) = argument("popup") {
        body.panel.popup = Some(text.to_owned());
        return "showing popup".into();
    }
    if let Some(text) = argument("addToLog") {
        body.log(text);
        return "Added log message".into();
    }
    if let Some(wanted) = argument("set operational mode") {
        body.panel.mode = match wanted {
            "manual" => OperationalMode::Manual,
            "automatic" => OperationalMode::Automatic,
            _ => return format!("Failed setting operational mode: {wanted}"),
        };
        return format!("Setting operational mode: {}", body.panel.mode.word());
    }
    match line {
        "addToLog" => "No log message to add".into(),
        _ => format!("could not understand: '{line}'"),
    }
}

fn robot_mode(body: &Body) -> &'static str {
    match outputs::robot_mode(body) {
        outputs::ROBOT_MODE_BOOTING => "BOOTING",
        outputs::ROBOT_MODE_POWER_OFF => "POWER_OFF",
        outputs::ROBOT_MODE_IDLE => "IDLE",
        _ => "RUNNING",
    }
}

fn program_state(body: &Body) -> &'static str {
    match body.runtime {
        Runtime::Stopped => "STOPPED",
        Runtime::Playing => "PLAYING",
        Runtime::Paused => "PAUSED",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::sim::ur::body::Safety;
    use crate::devices::sim::ur::config::{Individual, SimUrConfig};

    fn body() -> Body {
        let config = SimUrConfig::default();
        Body::new(&config, &Individual::draw(&config, 1), 1)
    }

    /// Asks line by line; a wish to stop or play is carried out.
    fn converse(body: &mut Body, lines: &[(&str, &str)]) {
        for (line, known) in lines {
            let (reply, wish) = answer(line, body);
            assert_eq!(&reply, known, "{line}");
            match wish {
                Some(Wish::Stop) => body.program_ended(),
                Some(Wish::Play(_)) => body.runtime = Runtime::Playing,
                None => {}
            }
        }
    }

    #[test]
    fn programs_are_loaded_played_and_stopped() {
        converse(
            &mut body(),
            &[
                ("programState", "STOPPED <unnamed>"),
                ("play", "Failed to execute: play"),
                ("pause", "Failed to execute: pause"),
                ("get loaded program", "No program loaded"),
                ("isProgramSaved", "false <unnamed>"),
                ("load other.urp", "File not found: /programs/other.urp"),
                ("load production.urp", "Loading program: /programs/production.urp"),
                ("isProgramSaved", "true production.urp"),
                ("play", "Starting program"),
                ("running", "Program running: true"),
                ("load production.urp", "Error while loading program: /programs/production.urp"),
                ("pause", "Pausing program"),
                ("programState", "PAUSED production.urp"),
                ("play", "Starting program"),
                ("stop", "Stopped"),
                ("programState", "STOPPED production.urp"),
                ("get loaded program", "Loaded program: /programs/production.urp"),
            ],
        );
    }

    #[test]
    fn power_and_the_rest() {
        let mut body = body();
        converse(
            &mut body,
            &[
                ("power off", "Powering off"),
                ("robotmode", "Robotmode: POWER_OFF"),
                ("load production.urp", "Loading program: /programs/production.urp"),
                ("play", "Failed to execute: play"),
                ("power on", "Powering on"),
                ("robotmode", "Robotmode: IDLE"),
                ("play", "Failed to execute: play"),
                ("brake release", "Brake releasing"),
                ("robotmode", "Robotmode: RUNNING"),
                ("power off", "Powering off"),
                ("brake release", "Brake releasing"),
                ("robotmode", "Robotmode: RUNNING"),
                ("popup out of paper", "showing popup"),
                ("addToLog it is late", "Added log message"),
                ("addToLog", "No log message to add"),
                ("set operational mode manual", "Setting operational mode: MANUAL"),
                ("get operational mode", "MANUAL"),
                ("set operational mode lazy", "Failed setting operational mode: lazy"),
                (
                    "clear operational mode",
                    "No longer controlling the operational mode. Current operational mode: 'NONE'.",
                ),
                ("shutdown", "Failed to execute: shutdown"),
                ("loading", "could not understand: 'loading'"),
                ("", "could not understand: ''"),
                ("quit", "Disconnected"),
            ],
        );
        assert_eq!(body.take_log(), ["it is late"]);
        assert_eq!(body.panel.popup.as_deref(), Some("out of paper"));
        body.config.remote_control = false;
        let refused = "Command is not allowed due to safety reasons";
        converse(
            &mut body,
            &[("play", refused), ("load production.urp", refused), ("running", "Program running: false")],
        );
    }

    #[test]
    fn a_protective_stop_is_unlocked_after_five_seconds() {
        let mut body = body();
        body.tick = 1000;
        body.protective_stop("test");
        body.tick += 2499;
        converse(&mut body, &[("unlock protective stop", TOO_EARLY), ("safetymode", "Safetymode: PROTECTIVE_STOP")]);
        body.tick += 1;
        converse(
            &mut body,
            &[("unlock protective stop", "Protective stop releasing"), ("safetymode", "Safetymode: NORMAL")],
        );
        body.cut_power(Safety::EmergencyStop);
        converse(&mut body, &[("power on", "Powering on"), ("brake release", "Brake releasing")]);
        assert!(!body.may_run() && !body.powered, "an emergency stop is not undone from here");
    }
}
