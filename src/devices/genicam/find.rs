//! Which cameras answer, and which one is meant.

use std::ffi::{CStr, c_char};
use std::sync::{Mutex, PoisonError};

use aravis::glib::prelude::*;
use aravis::prelude::*;
use aravis::{Camera, GvDevice};

use super::GenicamError;

/// A camera that answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// How Aravis names it.
    pub id: String,
    /// Maker.
    pub vendor: String,
    /// Model.
    pub model: String,
    /// Serial number.
    pub serial: String,
    /// `GigEVision` or `USB3Vision`.
    pub protocol: String,
    /// IP address, or place on the USB.
    pub address: String,
}

/// The cameras that answer now; takes up to about a second.
pub fn list() -> Vec<Found> {
    // The list of Aravis is one for the process.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    read_list()
}

#[expect(unsafe_code, reason = "the crate aravis leaves the serial number out of its list")]
fn read_list() -> Vec<Found> {
    use aravis_sys as sys;
    // SAFETY: only this function calls these, under a lock; each string is copied before the list changes again.
    unsafe {
        sys::arv_update_device_list();
        let found = |i| Found {
            id: text(sys::arv_get_device_id(i)),
            vendor: text(sys::arv_get_device_vendor(i)),
            model: text(sys::arv_get_device_model(i)),
            serial: text(sys::arv_get_device_serial_nbr(i)),
            protocol: text(sys::arv_get_device_protocol(i)),
            address: text(sys::arv_get_device_address(i)),
        };
        (0..sys::arv_get_n_devices()).map(found).collect()
    }
}

/// # Safety
/// `string` is null or a C string that lives until this returns.
#[expect(unsafe_code, reason = "strings of a C library")]
unsafe fn text(string: *const c_char) -> String {
    if string.is_null() {
        return String::new();
    }
    // SAFETY: as the caller promises.
    unsafe { CStr::from_ptr(string) }.to_string_lossy().into_owned()
}

/// The camera with this serial number, or the only one.
pub(super) fn open(serial: Option<&str>) -> Result<(Camera, Found), GenicamError> {
    let found = choose(list(), serial)?;
    let opened = Camera::new(Some(&found.id));
    let camera = opened.map_err(|error| GenicamError::Refused { what: "to be opened".into(), why: said(&error) })?;
    let device = camera.device().and_downcast::<GvDevice>();
    let ours = device.is_none_or(|device| device.is_controller());
    if ours { Ok((camera, found)) } else { Err(GenicamError::Busy { serial: found.serial }) }
}

fn choose(mut all: Vec<Found>, serial: Option<&str>) -> Result<Found, GenicamError> {
    let described = describe(&all);
    let found = if all.is_empty() {
        "none answers: is it powered, in the same subnet, and no firewall between?".to_owned()
    } else {
        format!("these answer: {described}")
    };
    match serial {
        Some(serial) => {
            let wanted = format!("has the serial number {serial}");
            all.into_iter().find(|f| f.serial == serial).ok_or(GenicamError::Missing { wanted, found })
        }
        None if all.len() > 1 => Err(GenicamError::Several { count: all.len(), found: described }),
        None => all.pop().ok_or(GenicamError::Missing { wanted: "was found".into(), found }),
    }
}

fn describe(all: &[Found]) -> String {
    let words = all.iter().map(|f| format!("{} {} {} at {}", f.vendor, f.model, f.serial, f.address));
    words.collect::<Vec<_>>().join(", ")
}

/// The words of Aravis.
pub(super) fn said(error: &aravis::glib::Error) -> String {
    error.message().trim().trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(serial: &str) -> Found {
        let [id, vendor, model] = ["Maker-1", "Maker", "M1"].map(str::to_owned);
        let (protocol, address) = ("GigEVision".to_owned(), "10.0.0.2".to_owned());
        Found { id, vendor, model, serial: serial.into(), protocol, address }
    }

    #[test]
    fn the_named_one_or_the_only_one_is_taken() {
        let both = || vec![found("A1"), found("B2")];
        assert_eq!(choose(both(), Some("B2")).unwrap().serial, "B2");
        assert_eq!(choose(vec![found("A1")], None).unwrap().serial, "A1");
        let errors =
            [choose(both(), Some("C3")), choose(both(), None), choose(vec![], None), choose(vec![], Some("C3"))];
        let said = errors.map(|e| e.unwrap_err().to_string());
        let expected = [
            "no GenICam camera has the serial number C3; these answer: Maker M1 A1 at 10.0.0.2, Maker M1 B2 at 10.0.0.2",
            "2 GenICam cameras answer; give rgb.serial of one: Maker M1 A1 at 10.0.0.2, Maker M1 B2 at 10.0.0.2",
            "no GenICam camera was found; none answers: is it powered, in the same subnet, and no firewall between?",
            "no GenICam camera has the serial number C3; none answers: is it powered, in the same subnet, and no firewall between?",
        ];
        assert_eq!(said, expected);
    }
}
