//! The world of a replay: recorded inputs, and commands that must be the recorded ones.

use super::World;
use crate::recording::{Entry, Recording};
use crate::session::{Command, Input, MoveTarget, Stamp};

/// The program no longer does what it did when the session was recorded.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Diverged {
    /// Another command.
    #[error("replay diverged at step {step}: recorded {recorded}, now {now}")]
    Command {
        /// Which command, counted from 1.
        step: usize,
        /// In the recording, or `nothing`.
        recorded: String,
        /// From this program.
        now: String,
    },
    /// Fewer commands.
    #[error("replay stopped after {steps} of {recorded} recorded commands")]
    LeftOver {
        /// Commands that this program gave.
        steps: usize,
        /// Commands in the recording.
        recorded: usize,
    },
}

/// A recorded session as a world.
pub struct Replay {
    inputs: std::vec::IntoIter<(Stamp, Input)>,
    commands: Vec<Command>,
    step: usize,
    /// A cut recording may lack the last command.
    whole: bool,
    /// Whether commands are compared at all.
    checked: bool,
}

impl Replay {
    /// Replays `recording`.
    pub fn new(recording: &Recording) -> Self {
        let (mut inputs, mut commands) = (Vec::new(), Vec::new());
        for entry in &recording.entries {
            match entry {
                Entry::Input(at, input) => inputs.push((*at, input.clone())),
                Entry::Command(command) => commands.push(command.clone()),
                Entry::Image(..) | Entry::Events(_) => {}
            }
        }
        Self { inputs: inputs.into_iter(), commands, step: 0, whole: recording.damage.is_empty(), checked: true }
    }

    /// Hands out the inputs of a damaged recording without comparing commands.
    pub fn unchecked(recording: &Recording) -> Self {
        Self { checked: false, ..Self::new(recording) }
    }
}

impl World for Replay {
    type Error = Diverged;

    fn execute(&mut self, command: &Command) -> Result<(), Diverged> {
        let recorded = self.commands.get(self.step);
        self.step += 1;
        let cut_here = recorded.is_none() && !self.whole;
        let same = recorded.is_some_and(|recorded| is_same(recorded, command));
        if same || cut_here || !self.checked {
            return Ok(());
        }
        let recorded = recorded.map_or_else(|| "nothing".into(), described);
        Err(Diverged::Command { step: self.step, recorded, now: described(command) })
    }

    fn next_input(&mut self) -> Result<Option<(Stamp, Input)>, Diverged> {
        Ok(self.inputs.next())
    }

    fn goes_on(&self) -> bool {
        matches!(self.inputs.as_slice().first(), Some((_, Input::Resumed)))
    }

    fn finish(&mut self) -> Result<(), Diverged> {
        let recorded = self.commands.len();
        let all = self.step >= recorded;
        if all || !self.checked { Ok(()) } else { Err(Diverged::LeftOver { steps: self.step, recorded }) }
    }
}

/// Whether both ask for the same; targets to 1e-9, which is what another CPU makes of the same plan.
pub(super) fn is_same(recorded: &Command, now: &Command) -> bool {
    let near = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-9);
    let same_target = |to_a: &MoveTarget, to_b: &MoveTarget| {
        let numbers = |target: &MoveTarget| match *target {
            MoveTarget::Joint { joints_rad, speed_rad_s, acceleration_rad_s2 } => {
                (true, joints_rad, [speed_rad_s, acceleration_rad_s2, 0.0, 0.0, 0.0, 0.0])
            }
            MoveTarget::Linear { tcp_pose, speed_m_s, acceleration_m_s2 } => {
                (false, tcp_pose, [speed_m_s, acceleration_m_s2, 0.0, 0.0, 0.0, 0.0])
            }
        };
        let ((joint_a, q_a, v_a), (joint_b, q_b, v_b)) = (numbers(to_a), numbers(to_b));
        joint_a == joint_b && near(&q_a, &q_b) && near(&v_a, &v_b)
    };
    match (recorded, now) {
        (Command::Move { pose: a, target: to_a }, Command::Move { pose: b, target: to_b }) => {
            a == b && same_target(to_a, to_b)
        }
        (Command::Travel { target: to_a, .. }, Command::Travel { target: to_b, .. }) => same_target(to_a, to_b),
        // The reason is text for people.
        (Command::Stop { .. }, Command::Stop { .. })
        | (Command::Confirm { .. }, Command::Confirm { .. })
        | (Command::Guide { .. }, Command::Guide { .. }) => true,
        (recorded, now) => recorded == now,
    }
}

pub(super) fn described(command: &Command) -> String {
    match command {
        Command::Move { pose, target } => format!("move to pose {} ({})", pose + 1, shown(target)),
        Command::Capture { pose, attempt } => format!("capture at pose {}, try {}", pose + 1, attempt + 1),
        Command::Wait { pose, attempt } => format!("wait at pose {} for try {}", pose + 1, attempt + 1),
        Command::Stop { why } => format!("stop: {why}"),
        Command::Confirm { question } => format!("ask: {question}"),
        Command::Start => "start the program".into(),
        Command::Travel { why, target } => format!("travel {why} ({})", shown(target)),
        Command::Watch => "watch the display".into(),
        Command::Guide { advice } => format!("advise: {advice}"),
        Command::Finish { load: None } => "finish".into(),
        Command::Finish { load: Some(program) } => format!("finish and load {program}"),
    }
}

fn shown(target: &MoveTarget) -> String {
    let list = |numbers: &[f64], factor: f64| {
        let each: Vec<_> = numbers.iter().map(|v| format!("{:.3}", v * factor)).collect();
        each.join(", ")
    };
    match target {
        MoveTarget::Joint { joints_rad, .. } => format!("joints {} deg", list(joints_rad, 1f64.to_degrees())),
        MoveTarget::Linear { tcp_pose, .. } => format!("in a line to {} mm", list(&tcp_pose[..3], 1e3)),
    }
}
