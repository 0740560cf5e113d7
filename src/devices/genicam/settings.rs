//! Sets a camera as the cell says, and reads everything back.

use std::collections::BTreeMap;

use aravis::prelude::*;
use aravis::{AcquisitionMode, Auto, Camera};

use super::find::said;
use super::pixels::FORMATS;
use super::{GenicamError, Timing};
use crate::config::{FrameCameraCell, FrameTrigger};

/// What is read back may differ from what was asked for by this part: cameras count in steps.
const TOLERANCE: f64 = 0.01;

type Result<T> = std::result::Result<T, GenicamError>;

/// What was set, as read back.
pub(super) struct Applied {
    pub(super) size: [u32; 2],
    /// Significant bits of a pixel.
    pub(super) bits: u32,
    pub(super) timing: Timing,
    /// By name, for the log.
    pub(super) settings: BTreeMap<String, String>,
}

/// Sets everything that the cell says about the camera.
pub(super) fn apply(camera: &Camera, cell: &FrameCameraCell) -> Result<Applied> {
    let setter = Setter { camera, cell };
    let mut settings = BTreeMap::new();
    let mut note = |name: &str, value: String| drop(settings.insert(name.to_owned(), value));
    camera.set_acquisition_mode(AcquisitionMode::Continuous).map_err(refused("continuous acquisition"))?;
    let (format, bits) = setter.pixel_format()?;
    note("pixel_format", format.into());
    let [x, y] = setter.region()?;
    note("offset_px", format!("{x}, {y}"));
    note("size_px", format!("{} x {}", cell.width, cell.height));
    let exposure_s = setter.exposure_s()?;
    note("exposure_s", format!("{exposure_s}"));
    if let Some(gain) = setter.gain()? {
        note("gain", format!("{gain}"));
    }
    let images_per_s = setter.images_per_s()?;
    note("images_per_s", format!("{images_per_s}"));
    let (trigger, line) = setter.trigger()?;
    note("trigger", trigger);
    note("exposure_line", setter.exposure_line(line.as_deref())?);
    if camera.is_gv_device() {
        // The largest packets that get through; where the camera cannot try that out its own size stays.
        let _ = camera.gv_auto_packet_size();
        note("packet_bytes", camera.gv_get_packet_size().map_err(refused("its packet size"))?.to_string());
    }
    let timing = Timing { trigger: cell.trigger, exposure_s, period_s: 1.0 / images_per_s };
    Ok(Applied { size: [cell.width, cell.height], bits, timing, settings })
}

fn refused(what: &str) -> impl Fn(aravis::glib::Error) -> GenicamError {
    move |error| GenicamError::Refused { what: what.to_owned(), why: said(&error) }
}

fn wrong(key: &'static str, wanted: impl ToString, found: String) -> GenicamError {
    GenicamError::Setting { key, wanted: wanted.to_string(), found }
}

struct Setter<'a> {
    camera: &'a Camera,
    cell: &'a FrameCameraCell,
}

impl Setter<'_> {
    fn has(&self, feature: &str) -> bool {
        self.camera.is_feature_available(feature).unwrap_or(false)
    }

    fn choices(&self, feature: &str) -> Vec<String> {
        let all = self.camera.dup_available_enumerations_as_strings(feature).unwrap_or_default();
        all.into_iter().map(Into::into).collect()
    }

    fn pixel_format(&self) -> Result<(&'static str, u32)> {
        let offered = self.choices("PixelFormat");
        let chosen = FORMATS.into_iter().find(|(name, _)| offered.iter().any(|o| o == name));
        let Some((name, bits)) = chosen else {
            let wanted = FORMATS.map(|(name, _)| name).join(", ");
            return Err(GenicamError::Format { found: offered.join(", "), wanted });
        };
        self.camera.set_pixel_format_from_string(name).map_err(refused(name))?;
        Ok((name, bits))
    }

    /// Width, height and place of the image; in the middle of the sensor where nothing is said.
    fn region(&self) -> Result<[i64; 2]> {
        let movable = self.has("OffsetX") && self.has("OffsetY");
        if movable {
            // The largest width and height depend on the offset.
            for offset in ["OffsetX", "OffsetY"] {
                self.camera.set_integer(offset, 0).map_err(refused(offset))?;
            }
        }
        let sides = [("width", "Width", self.cell.width), ("height", "Height", self.cell.height)];
        let mut place = [0; 2];
        for (i, (key, feature, wanted)) in sides.into_iter().enumerate() {
            let whole = self.integer(key, feature, i64::from(wanted))?;
            if movable {
                let offset = ["OffsetX", "OffsetY"][i];
                let middle = (whole - i64::from(wanted)) / 2;
                let step = self.camera.integer_increment(offset).unwrap_or(1).max(1);
                let wanted = self.cell.offset_px.map_or(middle / step * step, |px| i64::from(px[i]));
                self.integer("offset_px", offset, wanted)?;
                place[i] = wanted;
            } else if self.cell.offset_px.is_some_and(|px| px[i] != 0) {
                return Err(wrong("offset_px", format!("{:?}", self.cell.offset_px), "cannot move its image".into()));
            }
        }
        Ok(place)
    }

    /// Sets an integer, reads it back, and says how large it may be.
    fn integer(&self, key: &'static str, feature: &str, wanted: i64) -> Result<i64> {
        let (least, most) = self.camera.integer_bounds(feature).map_err(refused(feature))?;
        let step = self.camera.integer_increment(feature).unwrap_or(1).max(1);
        let fits = (least..=most).contains(&wanted) && (wanted - least) % step == 0;
        if !fits {
            return Err(wrong(key, wanted, format!("takes {least} to {most} in steps of {step}")));
        }
        self.camera.set_integer(feature, wanted).map_err(refused(feature))?;
        let set = self.camera.integer(feature).map_err(refused(feature))?;
        if set == wanted { Ok(most) } else { Err(wrong(key, wanted, format!("made {set} of it"))) }
    }

    fn exposure_s(&self) -> Result<f64> {
        let camera = self.camera;
        if camera.is_exposure_auto_available().unwrap_or(false) {
            camera.set_exposure_time_auto(Auto::Off).map_err(refused("a fixed exposure time"))?;
        }
        let wanted_s = self.cell.exposure_s;
        let (least_us, most_us) = camera.exposure_time_bounds().map_err(refused("its exposure times"))?;
        let bounds_s = [least_us * 1e-6, most_us * 1e-6];
        within("exposure_s", wanted_s, bounds_s)?;
        camera.set_exposure_time(wanted_s * 1e6).map_err(refused("the exposure time"))?;
        let set_s = camera.exposure_time().map_err(refused("its exposure time"))? * 1e-6;
        near("exposure_s", wanted_s, set_s)
    }

    fn gain(&self) -> Result<Option<f64>> {
        let camera = self.camera;
        if !camera.is_gain_available().unwrap_or(false) {
            return match self.cell.gain {
                Some(wanted) => Err(wrong("gain", wanted, "has no gain: remove it".into())),
                None => Ok(None),
            };
        }
        if camera.is_gain_auto_available().unwrap_or(false) {
            camera.set_gain_auto(Auto::Off).map_err(refused("a fixed gain"))?;
        }
        if let Some(wanted) = self.cell.gain {
            let (least, most) = camera.gain_bounds().map_err(refused("its gains"))?;
            within("gain", wanted, [least, most])?;
            camera.set_gain(wanted).map_err(refused("the gain"))?;
        }
        camera.gain().map(Some).map_err(refused("its gain"))
    }

    /// The rate at which it exposes by itself, or, triggered, the rate at which it may be triggered.
    fn images_per_s(&self) -> Result<f64> {
        let wanted = self.cell.images_per_s;
        if self.cell.trigger != FrameTrigger::FreeRun {
            return Ok(wanted);
        }
        let camera = self.camera;
        let (least, most) = camera.frame_rate_bounds().map_err(refused("its frame rates"))?;
        within("images_per_s", wanted, [least, most])?;
        camera.set_frame_rate(wanted).map_err(refused("the frame rate"))?;
        // Exposure and link may make it slower than what is set.
        let resulting = ["ResultingFrameRate", "AcquisitionResultingFrameRate", "ResultingFrameRateAbs"];
        let resulting = resulting.into_iter().find(|feature| self.has(feature));
        let set = resulting.map_or_else(|| camera.frame_rate(), |feature| camera.float(feature));
        near("images_per_s", wanted, set.map_err(refused("its frame rate"))?)
    }

    /// What begins an exposure, in words, and the input line that does.
    fn trigger(&self) -> Result<(String, Option<String>)> {
        let source = match self.cell.trigger {
            FrameTrigger::FreeRun => {
                self.camera.clear_triggers().map_err(refused("to run by itself"))?;
                return Ok(("free run".into(), None));
            }
            FrameTrigger::Software => "Software".to_owned(),
            FrameTrigger::RobotOutput(_) => self.trigger_line()?,
        };
        if !self.choices("TriggerSource").contains(&source) {
            let offered = self.choices("TriggerSource").join(", ");
            return Err(wrong("trigger", source, format!("can be triggered by {offered} only")));
        }
        self.camera.set_trigger(&source).map_err(refused("the trigger"))?;
        let line = matches!(self.cell.trigger, FrameTrigger::RobotOutput(_)).then(|| source.clone());
        Ok((source, line))
    }

    /// The input that the cell names, or the first one.
    fn trigger_line(&self) -> Result<String> {
        let offered = self.choices("TriggerSource");
        match &self.cell.trigger_line {
            Some(named) if !offered.contains(named) => {
                Err(wrong("trigger_line", named, format!("has {}", offered.join(", "))))
            }
            Some(named) => Ok(named.clone()),
            None => {
                let line = offered.iter().find(|source| source.starts_with("Line")).cloned();
                let none = || wrong("trigger", "an output of the robot", format!("has only {}", offered.join(", ")));
                line.ok_or_else(none)
            }
        }
    }

    /// Puts the exposure signal on an output, for the trigger input of the event camera; which one, in words.
    ///
    /// Only a line that is an output already is taken by itself: another one may be driven from outside.
    fn exposure_line(&self, trigger_line: Option<&str>) -> Result<String> {
        let named = self.cell.exposure_line.as_deref();
        if !self.cell.wired && named.is_none() {
            return Ok("not wanted".into());
        }
        let lines = if self.has("LineSource") { self.choices("LineSelector") } else { Vec::new() };
        for line in lines.iter().filter(|line| named.is_none_or(|n| n == *line) && trigger_line != Some(line)) {
            if self.expose_on(line, named.is_some()).is_ok_and(|done| done) {
                return Ok(line.clone());
            }
        }
        match named {
            Some(named) if lines.is_empty() => Err(wrong("exposure_line", named, "has no LineSource".into())),
            Some(named) => {
                let found = format!("cannot show its exposures there; its lines are {}", lines.join(", "));
                Err(wrong("exposure_line", named, found))
            }
            None => Ok("none that can be set; as the camera is wired".into()),
        }
    }

    fn expose_on(&self, line: &str, may_turn: bool) -> std::result::Result<bool, aravis::glib::Error> {
        let camera = self.camera;
        camera.set_string("LineSelector", line)?;
        if self.has("LineMode") && camera.string("LineMode")? != "Output" {
            if !may_turn {
                return Ok(false);
            }
            camera.set_string("LineMode", "Output")?;
        }
        camera.set_string("LineSource", "ExposureActive")?;
        Ok(camera.string("LineSource")? == "ExposureActive")
    }
}

fn within(key: &'static str, wanted: f64, [least, most]: [f64; 2]) -> Result<()> {
    let inside = (least..=most).contains(&wanted);
    if inside { Ok(()) } else { Err(wrong(key, wanted, format!("takes {least} to {most}"))) }
}

fn near(key: &'static str, wanted: f64, set: f64) -> Result<f64> {
    let close = (set - wanted).abs() <= TOLERANCE * wanted;
    if close { Ok(set) } else { Err(wrong(key, wanted, format!("made {set:.6} of it"))) }
}
