//! A writer on a thread of its own: encoding and syncing never hold up the loop that keeps the arm moving.
//!
//! Entries reach the file in the order in which they were given. A capture is on the disk soon after it was
//! given; [`Background::finish`] returns when everything is.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use super::cdr::EventPacket;
use super::{RecordingError, Writer};
use crate::image::GrayImage;
use crate::session::{Command, Input, Stamp};

/// Bytes that may wait for the disk; more is a disk that is too slow for the cameras.
const MAX_WAITING_BYTES: u64 = 1 << 30;

/// Turns an image into the bytes of a file.
type Encode = fn(&GrayImage) -> Result<Vec<u8>, String>;

enum Job {
    Input(Stamp, Box<Input>),
    Command(Stamp, Box<Command>),
    Image(Stamp, GrayImage),
    Events(Stamp, EventPacket),
    Sync,
}

impl Job {
    fn bytes(&self) -> u64 {
        match self {
            Self::Image(_, image) => image.pixels.len() as u64,
            Self::Events(_, packet) => packet.events.len() as u64,
            Self::Input(..) | Self::Command(..) | Self::Sync => 500,
        }
    }
}

/// A recording that is being written by its own thread.
pub struct Background {
    jobs: Option<Sender<Job>>,
    waiting: Arc<AtomicU64>,
    failed: Arc<Mutex<Option<RecordingError>>>,
    thread: Option<JoinHandle<Writer>>,
    partial: PathBuf,
}

impl Background {
    /// Hands `writer` to a thread; images become files by `encode`.
    pub fn new(writer: Writer, encode: Encode) -> Result<Self, RecordingError> {
        let partial = writer.partial();
        let (jobs, todo) = channel();
        let (waiting, failed) = (Arc::new(AtomicU64::new(0)), Arc::new(Mutex::new(None)));
        let (thread_waiting, thread_failed) = (Arc::clone(&waiting), Arc::clone(&failed));
        let work = move || work(writer, encode, &todo, &thread_waiting, &thread_failed);
        let spawned = std::thread::Builder::new().name("recording".into()).spawn(work);
        let thread = spawned.map_err(|why| RecordingError::Io { path: partial.clone(), why })?;
        Ok(Self { jobs: Some(jobs), waiting, failed, thread: Some(thread), partial })
    }

    /// Logs an input.
    pub fn input(&mut self, at: Stamp, input: &Input) -> Result<(), RecordingError> {
        self.give(Job::Input(at, Box::new(input.clone())))
    }

    /// Logs a command, before it is carried out.
    pub fn command(&mut self, at: Stamp, command: &Command) -> Result<(), RecordingError> {
        self.give(Job::Command(at, Box::new(command.clone())))
    }

    /// Logs the image of an exposure that began at `at`.
    pub fn image(&mut self, at: Stamp, image: GrayImage) -> Result<(), RecordingError> {
        self.give(Job::Image(at, image))
    }

    /// Logs raw words of the event camera.
    pub fn events(&mut self, at: Stamp, packet: EventPacket) -> Result<(), RecordingError> {
        self.give(Job::Events(at, packet))
    }

    /// Puts everything given so far on the disk, without waiting for it.
    pub fn sync(&mut self) -> Result<(), RecordingError> {
        self.give(Job::Sync)
    }

    /// Where the recording is until it is complete.
    pub fn partial(&self) -> PathBuf {
        self.partial.clone()
    }

    /// Waits until everything is on the disk, closes the file and gives it its final name.
    pub fn finish(mut self) -> Result<PathBuf, RecordingError> {
        let writer = self.end();
        self.check()?;
        writer.ok_or_else(|| self.broken("the thread that writes it has died"))?.finish()
    }

    /// Waits until everything is on the disk; the file keeps its `.partial` name.
    pub fn abandon(&mut self) -> PathBuf {
        if let Some(mut writer) = self.end() {
            // What cannot be synced now was told when it was written.
            drop(writer.sync());
        }
        self.partial.clone()
    }

    fn end(&mut self) -> Option<Writer> {
        self.jobs = None;
        self.thread.take()?.join().ok()
    }

    fn give(&mut self, job: Job) -> Result<(), RecordingError> {
        self.check()?;
        let waiting = self.waiting.fetch_add(job.bytes(), Ordering::Relaxed);
        if waiting > MAX_WAITING_BYTES {
            return Err(self.broken("the disk is too slow: more than 1 GB waits to be written"));
        }
        match self.jobs.as_ref().map(|jobs| jobs.send(job)) {
            Some(Ok(())) => Ok(()),
            Some(Err(_)) | None => Err(self.broken("the thread that writes it has died")),
        }
    }

    fn check(&self) -> Result<(), RecordingError> {
        let failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner).take();
        failed.map_or(Ok(()), Err)
    }

    fn broken(&self, what: &str) -> RecordingError {
        RecordingError::Broken { path: self.partial.clone(), what: what.into() }
    }
}

impl Drop for Background {
    fn drop(&mut self) {
        if self.jobs.is_some() {
            self.abandon();
        }
    }
}

/// Writes until nothing more is given; after an error nothing more is written.
fn work(
    mut writer: Writer,
    encode: Encode,
    todo: &Receiver<Job>,
    waiting: &AtomicU64,
    failed: &Mutex<Option<RecordingError>>,
) -> Writer {
    let mut broken = false;
    for job in todo {
        let bytes = job.bytes();
        if !broken && let Err(error) = write(&mut writer, encode, job) {
            broken = true;
            *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
        waiting.fetch_sub(bytes, Ordering::Relaxed);
    }
    writer
}

fn write(writer: &mut Writer, encode: Encode, job: Job) -> Result<(), RecordingError> {
    match job {
        Job::Input(at, input) => writer.input(at, &input),
        Job::Command(at, command) => writer.command(at, &command),
        Job::Events(at, packet) => writer.events(at, &packet),
        Job::Sync => writer.sync(),
        Job::Image(at, image) => {
            let path = writer.partial();
            let broken =
                |why: String| RecordingError::Broken { path, what: format!("an image cannot be stored: {why}") };
            writer.image(at, &encode(&image).map_err(broken)?, "png")
        }
    }
}
