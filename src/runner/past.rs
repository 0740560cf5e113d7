//! The past of a session that is resumed: its inputs again, and all that was logged copied into the new file.
//!
//! Commands must be the recorded ones, as in a replay; where the end of the old file is lost, those of the
//! machine are written instead.

use std::collections::VecDeque;

use super::World;
use super::replay::{Diverged, described, is_same};
use crate::recording::{Entry, Recording, RecordingError, Writer};
use crate::session::{Command, Input, Stamp};

/// Why a session cannot be copied.
#[derive(Debug, thiserror::Error)]
pub enum PastError {
    /// The program decides differently now, or the recording is damaged in the middle.
    #[error("the session cannot be resumed: {0}; begin a new one")]
    Diverged(Diverged),
    /// The new file cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// Its words are in ours: it is no further cause.
impl From<Diverged> for PastError {
    fn from(diverged: Diverged) -> Self {
        Self::Diverged(diverged)
    }
}

/// A recorded session as a world that writes itself anew.
pub struct Past<'a> {
    entries: VecDeque<Entry>,
    commands: VecDeque<Command>,
    writer: &'a mut Writer,
    /// Images and events of a capture whose end has not been seen yet.
    waiting: Vec<Entry>,
    /// Whether a capture has begun and not ended.
    capturing: bool,
    step: usize,
    last: Stamp,
}

impl<'a> Past<'a> {
    /// The past in `recording`, copied to `writer`.
    pub fn new(recording: Recording, writer: &'a mut Writer) -> Self {
        let (mut entries, mut commands) = (VecDeque::new(), VecDeque::new());
        for entry in recording.entries {
            match entry {
                Entry::Command(command) => commands.push_back(command),
                other => entries.push_back(other),
            }
        }
        Self { entries, commands, writer, waiting: Vec::new(), capturing: false, step: 0, last: Stamp::default() }
    }

    /// The stamp of the last input.
    pub fn last(&self) -> Stamp {
        self.last
    }

    fn copy_waiting(&mut self) -> Result<(), RecordingError> {
        for entry in std::mem::take(&mut self.waiting) {
            match entry {
                Entry::Image(at, bytes) => self.writer.image(at, &bytes, "png")?,
                Entry::Events(packet) => self.writer.events(Stamp(packet.stamp_ns), &packet)?,
                Entry::Input(..) | Entry::Command(_) => {}
            }
        }
        Ok(())
    }
}

impl World for Past<'_> {
    type Error = PastError;

    fn execute(&mut self, command: &Command) -> Result<(), PastError> {
        self.step += 1;
        self.capturing |= matches!(command, Command::Capture { .. } | Command::Watch);
        if let Some(recorded) = self.commands.pop_front().filter(|recorded| !is_same(recorded, command)) {
            let (recorded, now) = (described(&recorded), described(command));
            return Err(Diverged::Command { step: self.step, recorded, now }.into());
        }
        Ok(self.writer.command(self.last, command)?)
    }

    fn next_input(&mut self) -> Result<Option<(Stamp, Input)>, PastError> {
        while let Some(entry) = self.entries.pop_front() {
            let Entry::Input(at, input) = entry else {
                self.waiting.push(entry);
                continue;
            };
            let ended = matches!(input, Input::Captured(_) | Input::Watched(_) | Input::CaptureFailed { .. });
            if matches!(input, Input::Captured(_) | Input::Watched(_)) || !self.capturing {
                self.copy_waiting()?;
            }
            self.capturing &= !ended;
            self.last = at;
            self.writer.input(at, &input)?;
            return Ok(Some((at, input)));
        }
        // What is left belongs to a capture that never ended.
        Ok(None)
    }

    fn goes_on(&self) -> bool {
        let next = self.entries.iter().find(|e| matches!(e, Entry::Input(..)));
        matches!(next, Some(Entry::Input(_, Input::Resumed)))
    }

    fn finish(&mut self) -> Result<(), PastError> {
        if !self.commands.is_empty() {
            // Inputs in the middle are lost: where the arm went is not known.
            let recorded = self.step + self.commands.len();
            return Err(Diverged::LeftOver { steps: self.step, recorded }.into());
        }
        Ok(self.writer.sync()?)
    }
}
