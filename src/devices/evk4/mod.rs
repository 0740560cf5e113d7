//! The Prophesee EVK4 over USB: opens it, sets its pixels, hands over its packets. Feature `evk4`.
//!
//! Thin on purpose: everything above it is [`super::event_stream`], which is tested with replayed payloads. Biases are
//! offsets from the sensor's own calibration, as in the cell file.

use std::sync::Arc;
use std::time::Duration;

use neuromorphic_drivers as nd;
use neuromorphic_drivers::{GenericDevice as _, UsbDevice as _};

use super::event_stream::{Packet, PacketSource, StreamedCamera};
use super::{CameraError, CameraFacts, Clock};
use crate::config::{Biases, EventCameraCell};
use crate::events::Format;
use crate::geometry::Camera;
use crate::session::Stamp;

/// Width and height of its sensor, pixels.
pub const SIZE: [u32; 2] = [1280, 720];

fn failed(why: impl Into<String>) -> CameraError {
    CameraError::Failed { camera: Camera::Event, why: why.into() }
}

/// Serial numbers of the EVK4s at this computer's USB ports; a camera that does not tell has the reason instead.
///
/// # Errors
/// [`CameraError::Failed`] if USB cannot be asked.
pub fn list() -> Result<Vec<Result<String, String>>, CameraError> {
    let of_usb = |error: nd::rusb::Error| failed(format!("USB: {error}"));
    let context = nd::rusb::Context::new().map_err(of_usb)?;
    let devices = nd::rusb::UsbContext::devices(&context).map_err(of_usb)?;
    let listed = nd::prophesee_evk4::Device::list_devices(&devices).map_err(of_usb)?;
    Ok(listed.into_iter().map(|device| device.serial.map_err(|error| error.to_string())).collect())
}

/// Opens the camera of a cell; packets are stamped by `clock`.
///
/// # Errors
/// [`CameraError::Failed`] for a size that is not the sensor's, for filters, which this driver cannot set, for biases
/// outside the sensor's range, and when the camera cannot be opened.
pub fn open(cell: &EventCameraCell, clock: Arc<dyn Clock>) -> Result<StreamedCamera, CameraError> {
    if [cell.width, cell.height] != SIZE {
        let [width, height] = SIZE;
        return Err(failed(format!(
            "an EVK4 has {width} x {height} pixels, the cell says {} x {}",
            cell.width, cell.height
        )));
    }
    if cell.filters.trail_us.is_some() || cell.filters.anti_flicker_hz.is_some() {
        return Err(failed("this driver cannot set event.filters; leave them out"));
    }
    let configuration = configuration(&cell.biases).map_err(failed)?;
    let (flag, event_loop) = nd::flag_and_event_loop().map_err(|error| failed(error.to_string()))?;
    let identifier = cell.serial.as_deref().map_or(nd::Identifier::None, nd::Identifier::Serial);
    let settings =
        cell.biases.offsets().into_iter().map(|(name, value)| (name.to_owned(), value.to_string())).collect();
    let ring = &nd::prophesee_evk4::RING_CONFIGURATION;
    let device = nd::prophesee_evk4::open(identifier, configuration, ring, event_loop, flag.clone());
    let device = device.map_err(|error| {
        let wanted =
            cell.serial.as_deref().map_or("any EVK4".into(), |serial| format!("the EVK4 with serial {serial}"));
        failed(format!("cannot open {wanted}: {error}; is it plugged into a USB 3 port, and may this user open it?"))
    })?;
    let serial = Some(device.serial());
    let facts = CameraFacts { model: "Prophesee EVK4 HD".into(), serial, firmware: None, settings };
    let source = Usb { device, flag, clock: Arc::clone(&clock) };
    StreamedCamera::start(Box::new(source), facts, SIZE, Format::Evt3, clock)
}

/// The factory's settings with the biases of a cell and the trigger input switched on.
fn configuration(biases: &Biases) -> Result<nd::prophesee_evk4::Configuration, String> {
    let mut configuration = nd::prophesee_evk4::DEFAULT_CONFIGURATION;
    configuration.enable_external_trigger = true;
    let of = &mut configuration.biases;
    for (name, offset) in biases.offsets() {
        let slot = match name {
            "diff_on" => &mut of.diff_on,
            "diff_off" => &mut of.diff_off,
            "fo" => &mut of.fo,
            "hpf" => &mut of.hpf,
            "refr" => &mut of.refr,
            other => return Err(format!("this driver has no bias {other}")),
        };
        let wrong = |_| format!("event.biases.{name} is {offset}, which no sensor takes");
        *slot = i16::try_from(offset).map_err(wrong)?;
    }
    Ok(configuration)
}

/// The camera's packets.
struct Usb {
    device: nd::prophesee_evk4::Device,
    flag: nd::Flag<nd::Error, nd::UsbOverflow>,
    clock: Arc<dyn Clock>,
}

impl PacketSource for Usb {
    fn next(&mut self, wait: Duration) -> Result<Option<Packet>, String> {
        self.flag.load_error().map_err(|error| format!("{error}; was it unplugged?"))?;
        let Some(view) = self.device.next_with_timeout(&wait) else { return Ok(None) };
        // The transfer was complete a moment ago.
        let arrived_s = self.clock.now().seconds() - view.delay().as_secs_f64();
        let arrived = Stamp::from_seconds(arrived_s.max(0.0));
        Ok(Some(Packet { words: view.slice.to_vec(), arrived, after_loss: view.first_after_overflow }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::BiasPreset;

    #[test]
    fn the_published_biases_are_set_and_the_trigger_input_is_on() {
        let biases = Biases { preset: BiasPreset::Paper, hpf: Some(60), ..Biases::default() };
        let set = configuration(&biases).unwrap();
        let of = &set.biases;
        assert_eq!([of.diff_on, of.diff_off, of.fo, of.hpf, of.refr], [-35, -15, -35, 60, 0]);
        assert!(set.enable_external_trigger);
        let factory = configuration(&Biases::default()).unwrap();
        assert_eq!(factory.biases, nd::prophesee_evk4::DEFAULT_CONFIGURATION.biases);
    }
}
