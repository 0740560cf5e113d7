//! A client that only looks: no inputs, no script, no motion.

use std::sync::Arc;

use tokio::runtime::Runtime;

use super::config::UrConfig;
use super::connection::{Connection, event_loop};
use super::dashboard::RobotInfo;
use super::samples::{Fresh, Freshness, next_sample};
use super::supervisor::Supervisor;
use crate::devices::rtde::ControllerVersion;
use crate::devices::{Clock, RobotError};
use crate::session::{Kinematics, RobotFacts, RobotSample, Stamp};

/// Reads the state of a Universal Robots controller and never touches it.
///
/// It asks for RTDE outputs only: it claims no input, uploads no script and therefore neither holds nor
/// moves the arm. It works beside any other client, in every robot mode, and while freedrive is active.
/// Owns an event loop: must not be used from async code.
pub struct UrMonitor {
    config: UrConfig,
    clock: Arc<dyn Clock>,
    runtime: Runtime,
    connection: Connection,
    freshness: Freshness,
    supervisor: Supervisor,
    info: RobotInfo,
}

impl std::fmt::Debug for UrMonitor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("UrMonitor").field("config", &self.config).finish_non_exhaustive()
    }
}

impl UrMonitor {
    /// Connects to RTDE, asks the controller who it is, and starts the outputs.
    ///
    /// Fails where the controller is not reachable, does not speak RTDE 2 or does not know an output.
    pub fn connect(config: &UrConfig, clock: Arc<dyn Clock>) -> Result<Self, RobotError> {
        let runtime = event_loop(config)?;
        let (connection, supervisor, info) = runtime.block_on(async {
            let mut connection = Connection::open(config, &[], &[]).await?;
            let supervisor = Supervisor::of(connection.version());
            // Before the start: samples that wait for this answer would be the first to be judged.
            let info = supervisor.info(config).await;
            connection.start().await.map(|()| (connection, supervisor, info))
        })?;
        let freshness = Freshness::default();
        Ok(Self { config: config.clone(), clock, runtime, connection, freshness, supervisor, info })
    }

    /// Waits for the next fresh sample, under the rules of the driver: late ones are passed over, and
    /// nothing fresh for [`UrConfig::stale_after`] is an error.
    pub fn next_sample(&mut self) -> Result<(Stamp, RobotSample), RobotError> {
        let Self { runtime, connection, freshness, clock, config, .. } = self;
        let Fresh { at, sample, .. } = runtime.block_on(next_sample(connection, freshness, &**clock, config))?;
        Ok((at, sample))
    }

    /// Version of the controller, by RTDE.
    pub fn controller_version(&self) -> ControllerVersion {
        self.connection.version()
    }

    /// The robot as its controller described it, beside RTDE; empty where it does not.
    pub fn robot_info(&self) -> &RobotInfo {
        &self.info
    }

    /// Asks for the description again: remote control may have been switched.
    ///
    /// May take some times [`UrConfig::answer_within`]; the samples that come in the meantime are passed over
    /// as late. Asks nothing where there has never been an answer.
    pub fn refresh_info(&mut self) {
        if self.info != RobotInfo::default() {
            self.info = self.runtime.block_on(self.supervisor.info(&self.config));
        }
    }

    /// What pre-flight looks at, with the kinematics as they were read; nothing is going to move the arm.
    pub fn facts(&self, kinematics: Option<Kinematics>) -> RobotFacts {
        let ControllerVersion { major, minor, bugfix, build } = self.controller_version();
        let RobotInfo { model, serial, remote_control, .. } = self.info.clone();
        RobotFacts {
            controller_version: [major, minor, bugfix, build],
            model,
            serial,
            remote_control,
            kinematics,
            ..RobotFacts::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::devices::Robot as _;
    use crate::devices::sim::ur::{SimController, SimUrConfig};
    use crate::devices::ur::UrRobot;

    fn simulator() -> (SimController, UrConfig) {
        let config = SimUrConfig { time_scale: 1.0, lock_step_patience: Duration::ZERO, ..SimUrConfig::default() };
        let sim = SimController::start(config, 1).unwrap();
        let ports = sim.ports();
        let config = UrConfig {
            rtde_port: ports.rtde,
            script_port: ports.secondary,
            primary_port: ports.primary,
            dashboard_port: Some(ports.dashboard),
            ..UrConfig::at(sim.address().to_string())
        };
        (sim, config)
    }

    #[test]
    fn it_takes_nothing_from_a_driver() {
        let (sim, config) = simulator();
        let mut before = UrMonitor::connect(&config, Arc::new(sim.clock())).unwrap();
        // Would be refused with IN_USE if an input were claimed.
        let mut robot = UrRobot::connect(&config, Arc::new(sim.clock())).unwrap();
        let mut after = UrMonitor::connect(&config, Arc::new(sim.clock())).unwrap();
        let joints = robot.next_sample().unwrap().1.target_joints_rad;
        for monitor in [&mut before, &mut after] {
            let (_, sample) = monitor.next_sample().unwrap();
            assert_eq!((sample.target_joints_rad, sample.runtime_state), (joints, 1), "nothing runs, nothing moves");
        }
        assert_eq!(before.facts(None).serial.as_deref(), Some("20235500001"));
        assert_eq!(before.facts(None).controller_version, [5, 12, 4, 1101]);
    }

    #[test]
    fn a_stopped_robot_is_seen_and_a_silent_one_is_an_error() {
        let (sim, config) = simulator();
        let mut monitor = UrMonitor::connect(&config, Arc::new(sim.clock())).unwrap();
        sim.handle().emergency_stop();
        let stopped = (0..100).any(|_| monitor.next_sample().unwrap().1.safety_mode == 7);
        assert!(stopped);
        sim.handle().mute(true);
        let error = (0..100).find_map(|_| monitor.next_sample().err());
        assert!(matches!(error, Some(RobotError::Silent { .. })), "{error:?}");
    }

    #[test]
    fn a_dashboard_that_never_answered_is_not_asked_again() {
        let (sim, config) = simulator();
        let config = UrConfig { dashboard_port: None, ..config };
        let mut monitor = UrMonitor::connect(&config, Arc::new(sim.clock())).unwrap();
        monitor.refresh_info();
        assert_eq!(monitor.robot_info(), &RobotInfo::default());
        monitor.next_sample().unwrap();
    }
}
