//! The answers of the dashboard server, in PolyScope 5 words.

use super::body::{Body, Runtime, Safety};
use super::link::Link;

/// Longest line of a client; a longer one closes the connection.
const MAX_LINE_BYTES: usize = 1024;

/// What greets a new client.
pub(super) const GREETING: &[u8] = b"Connected: Universal Robots Dashboard Server\n";

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

    /// Answers the lines that have come; true where one of them stops the program.
    pub(super) fn serve(&mut self, body: &mut Body) -> bool {
        let mut bytes = Vec::new();
        self.link.read(&mut bytes);
        let mut stop = false;
        for byte in bytes {
            if byte == b'\n' {
                let line = String::from_utf8_lossy(&std::mem::take(&mut self.line)).trim().to_owned();
                let refuses = body.dashboard_refuses;
                stop |= line == "stop" && !refuses;
                let reply = if refuses { format!("Failed to execute: {line}") } else { reply(&line, body) };
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
        stop
    }
}

fn reply(line: &str, body: &mut Body) -> String {
    let [major, minor, bugfix, build] = body.config.version;
    match line {
        "robotmode" => format!("Robotmode: {}", robot_mode(body)),
        "safetystatus" => format!("Safetystatus: {}", safety(body)),
        "safetymode" => format!("Safetymode: {}", safety(body)),
        "PolyscopeVersion" => format!("URSoftware {major}.{minor}.{bugfix}.{build} (Oct 26 2022)"),
        "is in remote control" => body.config.remote_control.to_string(),
        "get serial number" => body.config.serial.clone(),
        "get robot model" => body.config.model.clone(),
        "programState" => match body.runtime {
            Runtime::Stopped => "STOPPED".into(),
            Runtime::Playing => "PLAYING".into(),
            Runtime::Paused => "PAUSED".into(),
        },
        "running" => format!("Program running: {}", body.runtime == Runtime::Playing),
        "stop" => "Stopped".into(),
        "pause" => {
            body.pause_program();
            "Pausing program".into()
        }
        "play" => {
            body.resume_program();
            if body.runtime == Runtime::Playing { "Starting program" } else { "Failed to execute: play" }.into()
        }
        "close safety popup" => "closing safety popup".into(),
        "unlock protective stop" => {
            if body.safety == Safety::ProtectiveStop {
                body.safety = Safety::Normal;
            }
            "Protective stop releasing".into()
        }
        "quit" => "Disconnected".into(),
        other => format!("could not understand: '{other}'"),
    }
}

fn robot_mode(body: &Body) -> &'static str {
    match (body.is_booting(), body.powered) {
        (true, _) => "BOOTING",
        (false, true) => "RUNNING",
        (false, false) => "POWER_OFF",
    }
}

fn safety(body: &Body) -> &'static str {
    body.safety.name()
}
