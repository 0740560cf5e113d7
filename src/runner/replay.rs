//! The world of a replay: recorded inputs, and commands that must be the recorded ones.

use super::World;
use crate::recording::{Entry, Recording};
use crate::session::{Command, Input, Stamp};

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
}

impl Replay {
    /// Replays `recording`.
    pub fn new(recording: &Recording) -> Self {
        let (mut inputs, mut commands) = (Vec::new(), Vec::new());
        for entry in &recording.entries {
            match entry {
                Entry::Input(at, input) => inputs.push((*at, input.clone())),
                Entry::Command(command) => commands.push(command.clone()),
                Entry::Image(_) | Entry::Events(_) => {}
            }
        }
        Self { inputs: inputs.into_iter(), commands, step: 0, whole: recording.damage.is_empty() }
    }
}

impl World for Replay {
    type Error = Diverged;

    fn execute(&mut self, command: &Command) -> Result<(), Diverged> {
        let recorded = self.commands.get(self.step);
        self.step += 1;
        let cut_here = recorded.is_none() && !self.whole;
        if recorded == Some(command) || cut_here {
            return Ok(());
        }
        let recorded = recorded.map_or_else(|| "nothing".into(), described);
        Err(Diverged::Command { step: self.step, recorded, now: described(command) })
    }

    fn next_input(&mut self) -> Result<Option<(Stamp, Input)>, Diverged> {
        Ok(self.inputs.next())
    }

    fn finish(&mut self) -> Result<(), Diverged> {
        let recorded = self.commands.len();
        let all = self.step >= recorded;
        if all || !self.whole { Ok(()) } else { Err(Diverged::LeftOver { steps: self.step, recorded }) }
    }
}

fn described(command: &Command) -> String {
    match command {
        Command::Move { pose, target } => format!("move to pose {} ({target:?})", pose + 1),
        Command::Capture { pose, attempt } => format!("capture at pose {}, try {}", pose + 1, attempt + 1),
        Command::Wait { pose, attempt } => format!("wait at pose {} for try {}", pose + 1, attempt + 1),
        Command::Stop { why } => format!("stop: {why}"),
        Command::Finish => "finish".into(),
    }
}
