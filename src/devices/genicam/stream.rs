//! The thread that takes images in.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use aravis::prelude::*;
use aravis::{Buffer, BufferStatus, Camera, glib};

use super::clock::CameraClock;
use super::find::{self, said};
use super::settings::{self, Applied};
use super::{CameraFacts, GenicamError, Intake, Opened, Timing, pixels};
use crate::config::{FrameCameraCell, FrameTrigger};

/// Images that may wait for us.
const BUFFERS: usize = 12;
/// The longest wait for an image before the session is listened to again, microseconds.
const WAIT_US: u64 = 2000;
/// More images than this are not lost between two others: then the camera paused.
const LOST_MAX: u64 = 50;

/// A camera that sends.
pub(super) struct Stream {
    camera: Camera,
    stream: aravis::Stream,
    size: [u32; 2],
    bits: u32,
    timing: Timing,
    clock: CameraClock,
    gone: Arc<AtomicBool>,
    /// Number and begin of the last exposure, s.
    last: Option<(u64, f64)>,
    missing_packets: u64,
}

impl Stream {
    /// Opens and sets the camera and starts it.
    pub(super) fn open(cell: &FrameCameraCell) -> Result<(Self, Opened), GenicamError> {
        let (camera, found) = find::open(cell.serial.as_deref())?;
        let Applied { size, bits, timing, mut settings } = settings::apply(&camera, cell)?;
        let refused = |what: &str, error: &glib::Error| GenicamError::Refused { what: what.into(), why: said(error) };
        let firmware = ["DeviceFirmwareVersion", "DeviceVersion"]
            .into_iter()
            .filter(|feature| camera.is_feature_available(feature).unwrap_or(false))
            .find_map(|feature| camera.string(feature).ok());
        settings.insert("protocol".into(), found.protocol);
        settings.insert("address".into(), found.address);
        let facts = CameraFacts {
            model: format!("{} {}", found.vendor, found.model),
            serial: Some(found.serial),
            firmware: firmware.map(Into::into),
            settings,
        };
        let stream = camera.create_stream().map_err(|e| refused("a stream", &e))?;
        let payload = camera.payload().map_err(|e| refused("the size of its images", &e))?;
        for _ in 0..BUFFERS {
            stream.push_buffer(Buffer::new_allocate(payload as usize));
        }
        let gone = Arc::new(AtomicBool::new(false));
        if let Some(device) = camera.device() {
            let gone = Arc::clone(&gone);
            device.connect_control_lost(move |_| gone.store(true, Ordering::Relaxed));
        }
        camera.start_acquisition().map_err(|e| refused("to begin", &e))?;
        let (clock, last, missing_packets) = (CameraClock::default(), None, 0);
        let stream = Self { camera, stream, size, bits, timing, clock, gone, last, missing_packets };
        Ok((stream, Opened { facts, size, timing }))
    }

    /// Takes images in until the camera is closed or gone.
    pub(super) fn run(mut self, intake: &Intake) {
        while !intake.has_ended() && !self.gone.load(Ordering::Relaxed) {
            if self.timing.trigger == FrameTrigger::Software
                && intake.claim_trigger()
                && let Err(error) = self.camera.software_trigger()
            {
                intake.fail(format!("it refused a trigger: {}; is it connected and powered?", said(&error)));
            }
            if let Some(buffer) = self.stream.timeout_pop_buffer(WAIT_US) {
                self.take(&buffer, intake);
                self.stream.push_buffer(buffer);
            }
        }
        if self.gone.load(Ordering::Relaxed) {
            intake.fail("it does not answer any more; is it connected and powered?".into());
        }
        // A camera that is gone cannot be stopped.
        let _ = self.camera.stop_acquisition();
    }

    fn take(&mut self, buffer: &Buffer, intake: &Intake) {
        let whole = buffer.status() == BufferStatus::Success;
        let lost_packets = self.lost_packets();
        let exposure_s = self.timing.exposure_s;
        let arrived_s = intake.now_s() - age_s(buffer.system_timestamp());
        // The stamp of a broken image may be broken too.
        let stamp_ns = if whole { buffer.timestamp() } else { 0 };
        let start_s = self.clock.end_s(stamp_ns, arrived_s) - exposure_s;
        for missing in self.missing_before(buffer.frame_id(), start_s) {
            intake.take(missing, 0, || Ok(None));
        }
        let (size, bits) = (self.size, self.bits);
        let image = || match whole {
            true => pixels::gray(&buffer.image_data(), size, bits).map(Some),
            false => Ok(None),
        };
        intake.take(start_s, if whole { 0 } else { lost_packets }, image);
    }

    /// Packets that were lost since the last image.
    fn lost_packets(&mut self) -> u32 {
        if !self.camera.is_gv_device() {
            return 0;
        }
        let missing = self.stream.info_uint64_by_name("n_missing_packets");
        let since = missing.saturating_sub(self.missing_packets);
        self.missing_packets = missing;
        u32::try_from(since).unwrap_or(u32::MAX)
    }

    /// When free-running exposures began of which nothing arrived: images were counted and time passed for them.
    fn missing_before(&mut self, id: u64, start_s: f64) -> Vec<f64> {
        let before = self.last.replace((id, start_s));
        let Some((before_id, before_s)) = before else { return Vec::new() };
        if self.timing.trigger != FrameTrigger::FreeRun {
            return Vec::new();
        }
        let count = missing_between((before_id, before_s), (id, start_s), self.timing.period_s);
        (1..=count).map(|i| before_s + i as f64 * self.timing.period_s).collect()
    }
}

/// How long ago by the system's clock, s; a clock that was set in between is not believed.
fn age_s(system_ns: u64) -> f64 {
    let now_us = glib::real_time();
    let age_us = now_us.saturating_sub(i64::try_from(system_ns / 1000).unwrap_or(now_us));
    if (0..1_000_000).contains(&age_us) { age_us as f64 * 1e-6 } else { 0.0 }
}

/// Images that were made between two, if their numbers and their times agree about it.
fn missing_between(before: (u64, f64), now: (u64, f64), period_s: f64) -> u64 {
    // GigE Vision counts with 16 bits and leaves 0 out.
    let counted = if now.0 >= before.0 { now.0 - before.0 } else { (now.0 + 65535).saturating_sub(before.0) };
    let passed = ((now.1 - before.1) / period_s).round();
    let agreed = counted as f64 == passed && (2..=LOST_MAX).contains(&counted);
    if agreed { counted - 1 } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_missed_where_numbers_and_times_agree() {
        assert_eq!(missing_between((7, 1.0), (8, 1.1), 0.1), 0);
        assert_eq!(missing_between((7, 1.0), (10, 1.302), 0.1), 2);
        assert_eq!(missing_between((65534, 1.0), (2, 1.3), 0.1), 2, "the count begins anew at 1");
        assert_eq!(missing_between((7, 1.0), (8, 1.3), 0.1), 0, "the camera paused");
        assert_eq!(missing_between((9, 1.0), (3, 1.1), 0.1), 0, "numbers without order");
        assert_eq!(missing_between((7, 1.0), (8000, 800.3), 0.1), 0);
    }
}
