//! What supervises the programs of a controller: the dashboard of PolyScope 5; PolyScope X has a REST
//! interface instead, which refuses politely for now.

use super::config::UrConfig;
use super::dashboard::{Dashboard, RobotInfo};
use crate::devices::RobotError;
use crate::devices::rtde::ControllerVersion;

/// First major version of PolyScope X.
const POLYSCOPE_X: u32 = 10;

/// Whoever knows about programs on the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Supervisor {
    Dashboard,
    /// Its REST interface is not spoken yet.
    PolyscopeX,
}

impl Supervisor {
    pub(super) fn of(version: ControllerVersion) -> Self {
        if version.major >= POLYSCOPE_X { Self::PolyscopeX } else { Self::Dashboard }
    }

    /// The robot as it is described; empty where nobody answers.
    pub(super) async fn info(self, config: &UrConfig) -> RobotInfo {
        match self {
            Self::Dashboard => match Dashboard::open(config).await {
                Ok(mut dashboard) => dashboard.info().await,
                Err(_) => RobotInfo::default(),
            },
            Self::PolyscopeX => RobotInfo::default(),
        }
    }

    /// Stops the program that is loaded, paused or running.
    pub(super) async fn stop_program(self, config: &UrConfig) -> Result<(), RobotError> {
        self.order(config, "stop", "Stopped", "the stop of a program").await
    }

    /// Loads a program; never starts it.
    pub(super) async fn load(self, config: &UrConfig, program: &str) -> Result<(), RobotError> {
        self.order(config, &format!("load {program}"), "Loading program", &format!("the load of {program}")).await
    }

    async fn order(self, config: &UrConfig, line: &str, good: &str, what: &str) -> Result<(), RobotError> {
        let refused = |why: String| RobotError::Refused { what: what.into(), why };
        match self {
            Self::PolyscopeX => Err(refused(
                "this controller runs PolyScope X, whose REST interface is not spoken yet; do it on the pendant".into(),
            )),
            Self::Dashboard => {
                let answer = Dashboard::open(config).await?.ask(line).await?;
                if answer.starts_with(good) { Ok(()) } else { Err(refused(format!("the dashboard says: {answer}"))) }
            }
        }
    }
}
