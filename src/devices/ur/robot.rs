//! The driver itself.

use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::Runtime;
use tokio::time::timeout;

use super::config::UrConfig;
use super::connection::Connection;
use super::dashboard::{self, RobotInfo};
use super::fields::{self, Order};
use super::script::{MOTION_SCRIPT, STOP_SCRIPT, ScriptPort};
use crate::devices::rtde::{ControllerVersion, TextMessage};
use crate::devices::{Clock, Robot, RobotError};
use crate::session::{ExecutorState, MoveTarget, RobotSample, Stamp};

const RUNNING: i32 = 7;
const NORMAL_OR_REDUCED: [i32; 2] = [1, 2];
const STOPPED: u32 = 1;
const PLAYING: u32 = 2;

/// Real time after which a silent socket is looked at again.
const LOOK_AGAIN: Duration = Duration::from_millis(20);

/// How often a controller that is still busy is tried, and the real time in between. An executor whose
/// client died is stopped by its watchdog within 0.15 s.
const TRIES: usize = 5;
const BETWEEN_TRIES: Duration = Duration::from_millis(200);

/// Share of time by which the two clocks may drift apart without counting as lateness.
const CLOCK_DRIFT: f64 = 1e-3;

/// A Universal Robots arm, moved by our script.
///
/// Owns an event loop: must not be used from async code. [`Robot::start_move`] only prepares the
/// command; it leaves with the next [`Robot::heartbeat`], in the same package.
pub struct UrRobot {
    config: UrConfig,
    clock: Arc<dyn Clock>,
    runtime: Runtime,
    connection: Connection,
    script: ScriptPort,
    info: RobotInfo,
    order: Order,
    heartbeat: i32,
    /// No heartbeats any more: the stop script could not be delivered, the watchdog has to stop the arm.
    withhold: bool,
    freshness: Freshness,
}

impl std::fmt::Debug for UrRobot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("UrRobot").field("config", &self.config).field("info", &self.info).finish_non_exhaustive()
    }
}

impl UrRobot {
    /// Connects, checks that the arm may move and that nothing else moves it, and starts our script.
    ///
    /// The arm does not move, but is held where it is. Returns when the script waits for commands.
    pub fn connect(config: &UrConfig, clock: Arc<dyn Clock>) -> Result<Self, RobotError> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|e| RobotError::Unreachable {
            address: config.host.clone(),
            why: format!("the system gives no event loop: {e}"),
        })?;
        let info = runtime.block_on(dashboard::read_info(config));
        if info.remote_control == Some(false) {
            let why = "it is in local control; switch the teach pendant to remote control".into();
            return Err(RobotError::Refused { what: "scripts".into(), why });
        }
        let (connection, script, freshness, sample) = runtime.block_on(open_when_free(config, &*clock))?;
        let order = Order::none(next_sequence(sample.executor_sequence));
        let (config, heartbeat, withhold) = (config.clone(), 0, false);
        let mut robot =
            Self { config, clock, runtime, connection, script, info, order, heartbeat, withhold, freshness };
        robot.start_script(&sample)?;
        Ok(robot)
    }

    fn start_script(&mut self, sample: &RobotSample) -> Result<(), RobotError> {
        let ready = sample.robot_mode == RUNNING && NORMAL_OR_REDUCED.contains(&sample.safety_mode);
        if !ready {
            let (robot, safety) = (sample.robot_mode, sample.safety_mode);
            let why = format!("robot mode is {robot} (7 is running), safety mode {safety} (1 is normal, 2 reduced)");
            return Err(RobotError::Refused { what: "motion".into(), why });
        }
        // The sequence is in place before the script reads its start value, so that its first report
        // shows that it is this script, of this connection.
        self.heartbeat()?;
        self.next_sample()?;
        let Self { runtime, script, config, .. } = self;
        runtime.block_on(script.upload(MOTION_SCRIPT, config))?;
        let sequence = self.order.sequence;
        self.wait_for("the motion script", |s| {
            let ours = s.executor_sequence == sequence && s.executor_state == ExecutorState::Idle;
            ours && s.runtime_state == PLAYING
        })?;
        Ok(())
    }

    /// Runs until a sample shows what is waited for, at most `program_within`.
    fn wait_for(&mut self, what: &str, done: impl Fn(&RobotSample) -> bool) -> Result<RobotSample, RobotError> {
        let (began, exceptions) = (self.clock.now(), self.connection.exceptions());
        loop {
            self.heartbeat()?;
            let (at, sample) = self.next_sample()?;
            if done(&sample) {
                return self.heartbeat().map(|()| sample);
            }
            let waited_s = at.seconds() - began.seconds();
            let patient = waited_s < self.config.program_within.as_secs_f64();
            if !patient || self.connection.exceptions() > exceptions {
                let why = format!("not there after {waited_s:.1} s, runtime state {}", sample.runtime_state);
                return Err(self.connection.refused(what, &why));
            }
        }
    }

    /// Version of the controller, by RTDE.
    pub fn controller_version(&self) -> ControllerVersion {
        self.connection.version()
    }

    /// The robot as its dashboard described it at the start.
    pub fn robot_info(&self) -> &RobotInfo {
        &self.info
    }

    /// The program that runs on the controller.
    pub fn script_text(&self) -> &'static str {
        MOTION_SCRIPT
    }

    /// SHA-256 of the program, lower-case hexadecimal.
    pub fn script_sha256(&self) -> String {
        super::script_sha256()
    }

    /// What the controller has said in words since the last call, at most the last 50.
    pub fn take_texts(&mut self) -> Vec<TextMessage> {
        self.connection.take_texts()
    }
}

impl Robot for UrRobot {
    fn next_sample(&mut self) -> Result<(Stamp, RobotSample), RobotError> {
        let Self { runtime, connection, freshness, clock, config, .. } = self;
        runtime.block_on(next_sample(connection, freshness, &**clock, config))
    }

    fn start_move(&mut self, target: &MoveTarget) -> Result<i32, RobotError> {
        self.config.caps.check(target)?;
        self.order = Order::move_to(next_sequence(self.order.sequence), target);
        Ok(self.order.sequence)
    }

    fn heartbeat(&mut self) -> Result<(), RobotError> {
        if self.withhold {
            return Ok(());
        }
        self.heartbeat = self.heartbeat.wrapping_add(1);
        let values = self.order.values(self.heartbeat);
        let within = self.config.stale_after;
        self.runtime.block_on(self.connection.send_inputs(&values, within))
    }

    /// Uploads a program that stops the arm: it replaces whatever runs, also in the middle of a move.
    ///
    /// Where it cannot be delivered, heartbeats cease as well, and the controller's watchdog stops the arm.
    fn stop(&mut self) -> Result<(), RobotError> {
        self.order = Order::none(self.order.sequence);
        let Self { runtime, script, config, withhold, .. } = self;
        let stopped = runtime.block_on(async {
            if script.upload(STOP_SCRIPT, config).await.is_err() {
                *script = ScriptPort::open(config).await?;
                script.upload(STOP_SCRIPT, config).await?;
            }
            Ok(())
        });
        *withhold = stopped.is_err();
        stopped
    }

    /// Asks the script to end, and stops it where it does not within `program_within`.
    fn finish(&mut self) -> Result<(), RobotError> {
        let what = "the end of the motion script";
        self.order = Order::end(next_sequence(self.order.sequence));
        if self.wait_for(what, |s| s.runtime_state != PLAYING).is_ok_and(|s| s.runtime_state == STOPPED) {
            return Ok(());
        }
        self.stop()?;
        // A paused program takes no script; the dashboard ends it.
        self.runtime.block_on(dashboard::stop_program(&self.config));
        self.wait_for(what, |s| s.runtime_state == STOPPED).map(drop)
    }
}

/// Sequence numbers are positive and wrap; 0 is what registers hold after power-on.
fn next_sequence(last: i32) -> i32 {
    last.checked_add(1).filter(|next| *next > 0).unwrap_or(1)
}

/// Connects, and tries again while a program runs: perhaps an executor whose client has just died.
async fn open_when_free(
    config: &UrConfig,
    clock: &dyn Clock,
) -> Result<(Connection, ScriptPort, Freshness, RobotSample), RobotError> {
    for _ in 0..TRIES {
        let mut connection = Connection::open(config).await?;
        let script = ScriptPort::open(config).await?;
        connection.start().await?;
        let mut freshness = Freshness::default();
        let (_, sample) = next_sample(&mut connection, &mut freshness, clock, config).await?;
        if sample.runtime_state != PLAYING {
            return Ok((connection, script, freshness, sample));
        }
        // Without a connection nothing feeds the watchdog of that program.
        drop(connection);
        tokio::time::sleep(BETWEEN_TRIES).await;
    }
    let why = "another program is running on the controller; stop it first".into();
    Err(RobotError::Refused { what: "the motion script".into(), why })
}

/// The next fresh sample.
async fn next_sample(
    connection: &mut Connection,
    freshness: &mut Freshness,
    clock: &dyn Clock,
    config: &UrConfig,
) -> Result<(Stamp, RobotSample), RobotError> {
    let asked = clock.now();
    let mut waited = Duration::ZERO;
    loop {
        while let Some(values) = connection.next_values()? {
            let sample = fields::sample_from(&values).map_err(|what| connection.protocol(what))?;
            let stamp = clock.now();
            let fresh = freshness.judge(stamp, sample.controller_time_s, config.stale_after);
            if fresh.map_err(|what| connection.protocol(what))? {
                return Ok((stamp, sample));
            }
        }
        match timeout(LOOK_AGAIN, connection.read()).await {
            Ok(read) => read?,
            Err(_) => waited += LOOK_AGAIN,
        }
        let silent_s = clock.now().seconds() - asked.seconds();
        let patient = silent_s <= config.stale_after.as_secs_f64() && waited < config.real_time_guard;
        if !patient {
            return Err(RobotError::Silent { silent_s: silent_s.max(waited.as_secs_f64()) });
        }
    }
}

/// Tells fresh samples from those that waited in some buffer, by comparing the two clocks.
#[derive(Debug, Clone, Copy, Default)]
struct Freshness {
    /// Stamp of the last fresh sample.
    last_seen: Option<Stamp>,
    last_controller_s: f64,
    /// Smallest stamp minus controller time so far, let go slowly.
    offset_s: f64,
}

impl Freshness {
    /// Whether a sample is new and not late; the error says that the controller's time ran backwards.
    fn judge(&mut self, stamp: Stamp, controller_s: f64, stale_after: Duration) -> Result<bool, String> {
        let offset_s = stamp.seconds() - controller_s;
        if self.last_seen.is_none() {
            *self = Self { last_seen: Some(stamp), last_controller_s: controller_s, offset_s };
            return Ok(true);
        }
        let passed_s = controller_s - self.last_controller_s;
        if passed_s < 0.0 {
            let before_s = self.last_controller_s;
            return Err(format!("controller time went from {before_s} s back to {controller_s} s; it has restarted"));
        }
        self.last_controller_s = controller_s;
        self.offset_s = (self.offset_s + CLOCK_DRIFT * passed_s).min(offset_s);
        let in_time = offset_s - self.offset_s <= stale_after.as_secs_f64();
        let fresh = passed_s > 0.0 && in_time;
        if fresh {
            self.last_seen = Some(stamp);
        }
        Ok(fresh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Duration = Duration::from_millis(100);

    #[test]
    fn samples_that_waited_are_not_fresh() {
        let mut freshness = Freshness::default();
        let mut judge =
            |now_s: f64, controller_s: f64| freshness.judge(Stamp::from_seconds(now_s), controller_s, LIMIT);
        assert_eq!(judge(1.000, 50.000), Ok(true));
        assert_eq!(judge(1.008, 50.008), Ok(true));
        assert_eq!(judge(1.009, 50.008), Ok(false), "the same again");
        assert_eq!(judge(1.200, 50.016), Ok(false), "waited for 184 ms");
        assert_eq!(judge(1.201, 50.190), Ok(true), "caught up");
        assert!(judge(1.3, 2.0).is_err(), "restarted");
    }

    #[test]
    fn clocks_may_drift() {
        let mut freshness = Freshness::default();
        for i in 0..100_000 {
            let controller_s = 50.0 + 0.008 * f64::from(i);
            let stamp = Stamp::from_seconds(0.008 * f64::from(i) * (1.0 + 500e-6));
            assert_eq!(freshness.judge(stamp, controller_s, LIMIT), Ok(true), "{i}");
        }
    }

    #[test]
    fn sequence_numbers_stay_positive() {
        assert_eq!(next_sequence(0), 1);
        assert_eq!(next_sequence(i32::MAX), 1);
        assert_eq!(next_sequence(-7), 1);
    }
}
