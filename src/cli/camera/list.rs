//! `cellcal camera list`: the cameras that this build and this machine can see.

use std::path::Path;

use clap::Args;
use serde::Serialize;

use crate::cli::{Exit, print};

/// Where the system describes its cameras.
const VIDEO_CLASS: &str = "/sys/class/video4linux";

/// Lists the cameras that this build and this machine can see; GenICam cameras are asked by broadcast on every network.
#[derive(Debug, Args)]
pub(in crate::cli) struct List {
    /// Prints JSON.
    #[arg(long)]
    json: bool,
}

/// A driver and what it can see.
#[derive(Debug, Serialize)]
struct Driver {
    /// As in the cell file: `rgb.driver` or `event.driver`.
    driver: &'static str,
    /// `rgb` or `event`.
    camera: &'static str,
    built_in: bool,
    /// How to get it, or what to do where nothing is found.
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<String>,
    cameras: Vec<Found>,
}

/// A camera that answers.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct Found {
    /// Maker and model.
    model: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    serial: Option<String>,
    /// Device or address.
    at: String,
}

impl List {
    pub(super) fn execute(self) -> anyhow::Result<Exit> {
        let drivers = drivers();
        if self.json {
            let told = serde_json::json!({ "schema_version": 1, "drivers": drivers });
            print(&format!("{}\n", serde_json::to_string_pretty(&told)?))?;
        } else {
            print(&drivers.iter().map(described).collect::<String>())?;
        }
        Ok(Exit::Ok)
    }
}

fn drivers() -> Vec<Driver> {
    let ready = |driver, camera, note: &str| Driver {
        driver,
        camera,
        built_in: true,
        note: Some(note.to_owned()),
        cameras: Vec::new(),
    };
    vec![
        genicam(),
        v4l2(Path::new(VIDEO_CLASS)),
        ready("folder", "rgb", "images of a folder, named by `rgb.source`"),
        ready("video", "rgb", "images of a video file, named by `rgb.source`"),
        ready("sim", "rgb", "simulated with the cell"),
        evk4(),
        ready("file", "event", "a RAW file, named by `event.source`"),
        ready("sim", "event", "simulated with the cell"),
    ]
}

#[cfg(not(feature = "evk4"))]
fn evk4() -> Driver {
    let note = Some(crate::cli::cameras::NO_EVK4.to_owned());
    Driver { driver: "evk4", camera: "event", built_in: false, note, cameras: Vec::new() }
}

#[cfg(feature = "evk4")]
fn evk4() -> Driver {
    let found = |serial: Result<String, String>| {
        let (serial, at) =
            serial.map_or_else(|why| (None, format!("USB, {why}")), |serial| (Some(serial), "USB".into()));
        Found { model: "Prophesee EVK4 HD".into(), serial, at }
    };
    let (cameras, note) = match crate::devices::evk4::list() {
        Ok(serials) if serials.is_empty() => (Vec::new(), Some("none at a USB port of this computer".to_owned())),
        Ok(serials) => (serials.into_iter().map(found).collect(), None),
        Err(why) => (Vec::new(), Some(why.to_string())),
    };
    Driver { driver: "evk4", camera: "event", built_in: true, note, cameras }
}

#[cfg(not(feature = "genicam"))]
fn genicam() -> Driver {
    let note = Some(crate::cli::cameras::NO_GENICAM.to_owned());
    Driver { driver: "genicam", camera: "rgb", built_in: false, note, cameras: Vec::new() }
}

#[cfg(feature = "genicam")]
fn genicam() -> Driver {
    use crate::devices::genicam;
    let found = |f: genicam::Found| Found {
        model: format!("{} {}", f.vendor, f.model),
        serial: Some(f.serial),
        at: format!("{} {}", f.protocol, f.address),
    };
    let cameras: Vec<_> = genicam::list().into_iter().map(found).collect();
    let none = "none answers; is it powered, in the same subnet, and no firewall between?";
    let note = cameras.is_empty().then(|| none.to_owned());
    Driver { driver: "genicam", camera: "rgb", built_in: true, note, cameras }
}

/// The devices that give images; a camera has more devices than that.
fn v4l2(class: &Path) -> Driver {
    let entries = std::fs::read_dir(class).into_iter().flatten().flatten();
    let mut cameras: Vec<Found> = entries.filter_map(|entry| device(&entry.path())).collect();
    cameras.sort_by_key(|found| (found.at.len(), found.at.clone()));
    let none = "no /dev/video device gives images; is the camera plugged in?";
    let note = cameras.is_empty().then(|| none.to_owned());
    Driver { driver: "v4l2", camera: "rgb", built_in: true, note, cameras }
}

fn device(described: &Path) -> Option<Found> {
    let name = described.file_name()?.to_str()?;
    let read = |file: &str| std::fs::read_to_string(described.join(file)).ok().map(|text| text.trim().to_owned());
    // The further devices of a camera carry what describes the images, and no images.
    let first = read("index").is_none_or(|index| index == "0");
    let found = Found { model: read("name")?, serial: None, at: format!("/dev/{name}") };
    (first && name.starts_with("video")).then_some(found)
}

/// A line a driver, a line a camera.
fn described(driver: &Driver) -> String {
    let Driver { driver, camera, built_in, note, cameras } = driver;
    let not = if *built_in { "" } else { "not built in: " };
    let note = note.as_deref().unwrap_or_default();
    let head = format!("{camera:<6} {driver:<8} {not}{note}").trim_end().to_owned() + "\n";
    let line = |f: &Found| {
        let serial = f.serial.as_deref().map(|serial| format!("  serial {serial}")).unwrap_or_default();
        format!("       - {}  {}{serial}\n", f.at, f.model)
    };
    head + &cameras.iter().map(line).collect::<String>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_that_give_images_are_listed_in_order() {
        let class = tempfile::tempdir().unwrap();
        let make = |name: &str, index: &str, model: &str| {
            let folder = class.path().join(name);
            std::fs::create_dir(&folder).unwrap();
            std::fs::write(folder.join("index"), format!("{index}\n")).unwrap();
            std::fs::write(folder.join("name"), format!("{model}\n")).unwrap();
        };
        make("video10", "0", "USB camera B");
        make("video2", "0", "USB camera A");
        make("video3", "1", "USB camera A");
        make("v4l-subdev0", "0", "a lens");
        let found = v4l2(class.path());
        let at: Vec<_> = found.cameras.iter().map(|f| (f.at.as_str(), f.model.as_str())).collect();
        assert_eq!(at, [("/dev/video2", "USB camera A"), ("/dev/video10", "USB camera B")]);
        assert_eq!(found.note, None);
        assert!(v4l2(&class.path().join("nothing")).note.unwrap().contains("plugged in"));
    }
}
