//! The dashboard server of PolyScope 5: one line asked, one line answered.

use std::time::Duration;

use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::time::timeout;

use super::config::UrConfig;
use super::connection::{broken, open};
use crate::devices::RobotError;

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

/// A connection to the dashboard.
pub(super) struct Dashboard {
    address: String,
    from: BufReader<OwnedReadHalf>,
    to: OwnedWriteHalf,
    within: Duration,
}

impl Dashboard {
    pub(super) async fn open(config: &UrConfig) -> Result<Self, RobotError> {
        let Some(port) = config.dashboard_port else {
            let (address, why) = (config.host.clone(), "no port of a dashboard is given".into());
            return Err(RobotError::Unreachable { address, why });
        };
        let address = config.address(port);
        let (from, to) = open(&address, config.answer_within).await?.into_split();
        let mut dashboard = Self { address, from: BufReader::new(from), to, within: config.answer_within };
        dashboard.line().await?;
        Ok(dashboard)
    }

    /// What it says about the robot.
    pub(super) async fn info(&mut self) -> RobotInfo {
        let digits = |s: &String| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
        // One that does not answer is not asked again.
        let Ok(model) = self.ask("get robot model").await else { return RobotInfo::default() };
        let model = Some(model).filter(|m| m.starts_with("UR"));
        let serial = self.ask("get serial number").await.ok().filter(digits);
        let version = self.ask("PolyscopeVersion").await.ok();
        let polyscope_version = version.and_then(|v| v.strip_prefix("URSoftware ").map(str::to_owned));
        let remote_control = self.ask("is in remote control").await.ok().and_then(|answer| answer.parse().ok());
        RobotInfo { model, serial, polyscope_version, remote_control }
    }

    /// Asks one line.
    pub(super) async fn ask(&mut self, question: &str) -> Result<String, RobotError> {
        let line = format!("{question}\n");
        self.to.write_all(line.as_bytes()).await.map_err(|e| broken(&self.address, &e))?;
        self.line().await
    }

    async fn line(&mut self) -> Result<String, RobotError> {
        let mut line = Vec::new();
        let mut limited = (&mut self.from).take(MAX_ANSWER_BYTES);
        match timeout(self.within, limited.read_until(b'\n', &mut line)).await {
            Ok(Ok(_)) if line.ends_with(b"\n") => Ok(String::from_utf8_lossy(&line).trim().to_owned()),
            Ok(Err(error)) => Err(broken(&self.address, &error)),
            Ok(Ok(_)) => {
                let what = "the dashboard closed the connection, or answered more than a line".into();
                Err(RobotError::Protocol { address: self.address.clone(), what })
            }
            Err(_) => {
                let what = format!("the dashboard does not answer within {:?}", self.within);
                Err(RobotError::Protocol { address: self.address.clone(), what })
            }
        }
    }
}
