//! What the dashboard server says about the robot; all of it optional.

use std::time::Duration;

use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::time::timeout;

use super::config::UrConfig;
use super::connection::open;

/// Longest answer that is read, bytes.
const MAX_ANSWER_BYTES: u64 = 1024;

/// The robot as its dashboard describes it; `None` where it does not say.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RobotInfo {
    /// Model, `UR5` for a UR5e too.
    pub model: Option<String>,
    /// Serial number.
    pub serial: Option<String>,
    /// Software version in words.
    pub polyscope_version: Option<String>,
    /// Whether scripts over the network are accepted.
    pub remote_control: Option<bool>,
}

/// Asks the dashboard; a controller without one gives an empty description.
pub(super) async fn read_info(config: &UrConfig) -> RobotInfo {
    let Some(mut dashboard) = Dashboard::open(config).await else { return RobotInfo::default() };
    let digits = |s: &String| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    let model = dashboard.ask("get robot model").await.filter(|m| m.starts_with("UR"));
    let serial = dashboard.ask("get serial number").await.filter(digits);
    let version = dashboard.ask("PolyscopeVersion").await;
    let polyscope_version = version.and_then(|v| v.strip_prefix("URSoftware ").map(str::to_owned));
    let remote_control = dashboard.ask("is in remote control").await.and_then(|answer| answer.parse().ok());
    RobotInfo { model, serial, polyscope_version, remote_control }
}

/// Stops the program that is loaded, paused or running; says nothing where there is no dashboard.
pub(super) async fn stop_program(config: &UrConfig) {
    if let Some(mut dashboard) = Dashboard::open(config).await {
        let _ = dashboard.ask("stop").await;
    }
}

struct Dashboard {
    from: BufReader<OwnedReadHalf>,
    to: OwnedWriteHalf,
    within: Duration,
}

impl Dashboard {
    async fn open(config: &UrConfig) -> Option<Self> {
        let stream = open(&config.address(config.dashboard_port?), config.answer_within).await.ok()?;
        let (from, to) = stream.into_split();
        let mut dashboard = Self { from: BufReader::new(from), to, within: config.answer_within };
        dashboard.line().await.map(|_greeting| dashboard)
    }

    async fn ask(&mut self, question: &str) -> Option<String> {
        self.to.write_all(format!("{question}\n").as_bytes()).await.ok()?;
        self.line().await
    }

    async fn line(&mut self) -> Option<String> {
        let mut line = Vec::new();
        let mut limited = (&mut self.from).take(MAX_ANSWER_BYTES);
        timeout(self.within, limited.read_until(b'\n', &mut line)).await.ok()?.ok()?;
        line.ends_with(b"\n").then(|| String::from_utf8_lossy(&line).trim().to_owned())
    }
}
