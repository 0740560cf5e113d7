//! Small data sets made in code, and what became of them.

mod bad_input;
mod image_pose;
mod session_folder;

use std::fs;
use std::path::{Path, PathBuf};

use super::*;
use crate::events::{Encoder, Event, Format, Header, Trigger};
use crate::recording::{Entry, EventPacket, Recording};
use crate::session::{Captured, Input};

pub(super) const WIDTH: u32 = 8;
pub(super) const HEIGHT: u32 = 6;
/// A host clock as real ones are, in seconds since 1970.
const HOST_S: f64 = 1_700_000_123.0;

/// The least that is a whole PNG for [`probe`]; no pixels.
pub(super) fn png(width: u32, height: u32) -> Vec<u8> {
    let size = [width.to_be_bytes(), height.to_be_bytes()].concat();
    let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_be_bytes(), kind, data, &[0; 4]].concat();
    [b"\x89PNG\r\n\x1a\n".to_vec(), chunk(b"IHDR", &size), chunk(b"IDAT", &[7; 5]), chunk(b"IEND", b"")].concat()
}

/// The least that is a whole JPEG for [`probe`]; no pixels.
pub(super) fn jpeg(width: u16, height: u16) -> Vec<u8> {
    let size = [width.to_be_bytes(), height.to_be_bytes()].concat();
    [&[0xff, 0xd8, 0xff, 0xe0], &*size, &[0xff, 0xd9, 0xff, 0xda, 1, 2, 0xff, 0, 0xff, 0xd9]].concat()
}

/// Stands in for a decoder.
fn probe(bytes: &[u8]) -> Result<(u32, u32), String> {
    let number = |range: std::ops::Range<usize>| {
        let bytes = bytes.get(range).ok_or("too short")?;
        Ok::<u32, String>(bytes.iter().fold(0, |sum, byte| sum << 8 | u32::from(*byte)))
    };
    if bytes.starts_with(b"\x89PNG") {
        Ok((number(16..20)?, number(20..24)?))
    } else {
        Ok((number(4..6)?, number(6..8)?))
    }
}

/// A session folder of three poses, two of them with two exposures and one with one, with images and events.
struct Fixture {
    dir: tempfile::TempDir,
}

impl Fixture {
    fn new() -> Self {
        let fixture = Self { dir: tempfile::tempdir().unwrap() };
        fixture.write("session.json", SESSION);
        fixture.write("poses.csv", &poses_csv());
        fixture.write("pairs.csv", "pair,pose_a,pose_b,d_gt_m\nP,b,c,0.05\n");
        fixture.write("frames.csv", &frames_csv());
        for (name, image) in [
            ("0.png", png(WIDTH, HEIGHT)),
            ("1.jpg", jpeg(8, 6)),
            ("3.png", png(WIDTH, HEIGHT)),
            ("4.png", png(WIDTH, HEIGHT)),
        ] {
            fixture.write_bytes(&format!("images/{name}"), &image);
        }
        fixture.write_bytes("events.raw", &raw(Format::Evt3, 2000).0);
        fixture
    }

    fn folder(&self) -> PathBuf {
        self.dir.path().join("paper set")
    }

    fn output(&self) -> PathBuf {
        self.dir.path().join("out/session.mcap")
    }

    fn write(&self, name: &str, text: &str) -> &Self {
        self.write_bytes(name, text.as_bytes())
    }

    fn write_bytes(&self, name: &str, bytes: &[u8]) -> &Self {
        let path = self.folder().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
        self
    }

    /// Replaces the one place of `from` in a text file.
    fn replace(&self, name: &str, from: &str, to: &str) -> &Self {
        let text = fs::read_to_string(self.folder().join(name)).unwrap();
        assert_eq!(text.matches(from).count(), 1, "`{from}` in {name}");
        self.write(name, &text.replace(from, to))
    }

    fn remove(&self, name: &str) -> &Self {
        fs::remove_file(self.folder().join(name)).unwrap();
        self
    }

    fn import(&self) -> Result<ImportReport, ImportError> {
        self.import_with(&ImportOptions { session_id: "s1".into(), ..Default::default() })
    }

    fn import_with(&self, options: &ImportOptions) -> Result<ImportReport, ImportError> {
        import_folder(&self.folder(), &self.output(), options)
    }

    /// Imports, then reads the session back.
    fn imported(&self) -> (ImportReport, Recording) {
        let report = self.import().unwrap();
        let recording = Recording::open(&report.path).unwrap();
        (report, recording)
    }
}

fn import_folder(folder: &Path, output: &Path, options: &ImportOptions) -> Result<ImportReport, ImportError> {
    let mut steps = Vec::new();
    let report = import(folder, output, options, &probe, &mut |done, total| steps.push((done, total)))?;
    let total = steps[0].1;
    assert!(steps.iter().copied().eq((0..=total).map(|done| (done, total))), "{steps:?}");
    Ok(report)
}

const SESSION: &str = r#"{
  "mode": "handeye",
  "alpha": 0.6,
  "toggle_hz": 15.0,
  "board": {"squares_x": 7, "squares_y": 5, "dictionary": "DICT_4X4_50", "square_m": 0.0088, "marker_m": 0.0070},
  "rgb": {"width": 8, "height": 6},
  "event": {"width": 1280, "height": 720, "raw": "events.raw"},
  "exposure_s": 0.0999,
  "fps": 10,
  "windows_per_pose": 2,
  "trigger": {"channel": 0, "rising": "exposure start", "falling": "exposure end"},
  "checks": {"corner_id": 9, "d_target_tcp_m": 0.0678}
}
"#;

/// Poses a (hand-eye), b and c (a pair for the distance check).
fn poses_csv() -> String {
    let row = |id: &str, kind: &str, pair: &str, at_s: f64, pose: &str, joints: &str| {
        format!("{id},{kind},{pair},{},{},{pose},{joints}\n", HOST_S + at_s, HOST_S + at_s + 0.5)
    };
    [
        "pose_id,kind,pair,t_still_from_host_s,t_still_to_host_s,x,y,z,rx,ry,rz,q0,q1,q2,q3,q4,q5\n".into(),
        row("a", "handeye", "", 0.75, "0.1,-0.4,0.3,3.1,0.2,-0.1", "0.1,-1.2,1.3,-1.5,-1.6,0.2"),
        row("b", "dist", "P", 2.75, "0.1,-0.4,0.35,0,3.14159,0", "0,0,0,0,0,0"),
        row("c", "distance", "P", 4.75, "0.1,-0.4,0.4,0,3.14159,0", ",,,,,"),
    ]
    .concat()
}

/// Exposures start at 1.0 and 1.125 s in a, 3.0 s in b (no image), 5.0 and 5.125 s in c.
fn frames_csv() -> String {
    let row = |id: u32, pose: &str, index: u32, at_s: f64, path: &str| {
        format!("f{id},{pose},{index},{},{},{path}\n", HOST_S + at_s, HOST_S + at_s + 0.1)
    };
    [
        "frame_id,pose_id,index_in_pose,t_exp_start_host_s,t_exp_end_host_s,path\n".into(),
        row(0, "a", 0, 1.0, "images/0.png"),
        row(1, "a", 1, 1.125, "images/1.jpg"),
        row(2, "b", 0, 3.0, ""),
        row(3, "c", 0, 5.0, "images/3.png"),
        row(4, "c", 1, 5.125, "images/4.png"),
    ]
    .concat()
}

/// A RAW file with triggers for [`frames_csv`], `per_ms` events a millisecond, and its triggers.
fn raw(format: Format, events: i64) -> (Vec<u8>, Vec<Trigger>) {
    // The sensor's own clock: 20 s ahead, so EVT3 has wrapped once before the first event.
    let edge = |at_s: f64, rising| Trigger { t_us: (at_s * 1e6) as i64 + 20_000_000, channel: 0, rising };
    let pulses =
        [(1.0, 0.1), (1.125, 0.1), (1.25, 0.01), (3.0, 0.1), (3.125, 0.01), (5.0, 0.1), (5.125, 0.1), (5.25, 0.01)];
    let triggers: Vec<Trigger> =
        pulses.iter().flat_map(|(at, long)| [edge(*at, true), edge(at + long, false)]).collect();
    let event = |i: i64| Event {
        t_us: 20_900_000 + i * 5_000_000 / events,
        x: (i * 37 % 1280) as u16,
        y: (i * 11 % 720) as u16,
        on: i % 3 == 0,
    };
    let mut bytes = Header::new(format, 1280, 720).to_bytes();
    let events: Vec<Event> = (0..events).map(event).collect();
    Encoder::new(format).encode(&events, &triggers, &mut bytes).unwrap();
    (bytes, triggers)
}

fn packets(recording: &Recording) -> Vec<&EventPacket> {
    let entries = recording.entries.iter();
    entries.filter_map(|entry| if let Entry::Events(packet) = entry { Some(packet) } else { None }).collect()
}

fn captures(recording: &Recording) -> Vec<(f64, &Captured)> {
    let mut captures = Vec::new();
    for entry in &recording.entries {
        if let Entry::Input(at, Input::Captured(captured)) = entry {
            captures.push((at.seconds(), captured));
        }
    }
    captures
}
