//! Aravis's own GigE Vision camera in this process, showing what a test paints; and a network of its own for it.

use std::ffi::c_void;
use std::os::unix::fs::MetadataExt as _;
use std::process::Command;

use aravis::GvFakeCamera;
use aravis::glib::translate::ToGlibPtr as _;
use aravis_sys as sys;

/// Set in the process that runs a test in a network of its own.
const ALONE: &str = "CELLCAL_TEST_NETWORK_OF_ITS_OWN";

/// Runs the body of the test `name` in a process and a network of its own, where there is nothing but `lo`.
///
/// Cameras are looked for by broadcast on every interface: outside such a network these tests refuse to run.
pub(super) fn alone(name: &str, body: impl FnOnce()) {
    if std::env::var_os(ALONE).is_some() {
        let interfaces = interfaces();
        assert_eq!(interfaces, ["lo"], "this is no network of its own");
        return body();
    }
    let root = std::fs::metadata("/proc/self").unwrap().uid() == 0;
    let output = Command::new("unshare")
        .args([if root { "-n" } else { "-rn" }, "sh", "-c", "ip link set lo up && exec \"$0\" \"$@\""])
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", &format!("genicam::{name}"), "--nocapture"])
        .env(ALONE, "yes")
        .output()
        .expect("`unshare` of util-linux makes the network of this test");
    let [said, printed] = [&output.stderr, &output.stdout].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    assert!(output.status.success() && printed.contains("1 passed"), "{}\n{printed}\n{said}", output.status);
}

/// The network interfaces of this process.
fn interfaces() -> Vec<String> {
    let table = std::fs::read_to_string("/proc/self/net/dev").unwrap();
    table.lines().skip(2).filter_map(|line| Some(line.split_once(':')?.0.trim().to_owned())).collect()
}

/// Fills the bytes of an image.
type Painter = Box<dyn FnMut(&mut [u8]) + Send>;

/// A GigE Vision camera on 127.0.0.1.
pub(super) struct FakeCamera {
    /// Goes first: its thread calls the painter.
    camera: Option<GvFakeCamera>,
    painter: *mut Painter,
}

impl FakeCamera {
    /// A camera with this serial number that shows what `painter` paints.
    pub(super) fn new(serial: &str, painter: impl FnMut(&mut [u8]) + Send + 'static) -> Self {
        Self::of(GvFakeCamera::new(Some("127.0.0.1"), Some(serial)), painter)
    }

    /// As [`FakeCamera::new`], with features of its own.
    pub(super) fn with_features(serial: &str, xml: &std::path::Path) -> Self {
        Self::of(GvFakeCamera::new_full(Some("127.0.0.1"), Some(serial), xml.to_str()), |_| {})
    }

    #[expect(unsafe_code, reason = "the crate aravis leaves the fill pattern out")]
    fn of(camera: GvFakeCamera, painter: impl FnMut(&mut [u8]) + Send + 'static) -> Self {
        assert!(camera.is_running(), "the fake camera does not run");
        let painter: *mut Painter = Box::into_raw(Box::new(Box::new(painter)));
        let fake = camera.fake_camera().unwrap();
        // SAFETY: the painter lives until the camera and its thread, the only one that calls it, are gone.
        unsafe { sys::arv_fake_camera_set_fill_pattern(fake.to_glib_none().0, Some(paint), painter.cast()) };
        Self { camera: Some(camera), painter }
    }

    /// Loses this part of the packets on the way.
    pub(super) fn lose(&self, part: f64) {
        self.camera.as_ref().unwrap().set_gvsp_lost_ratio(part);
    }
}

impl Drop for FakeCamera {
    #[expect(unsafe_code, reason = "takes back what was lent to a C library")]
    fn drop(&mut self) {
        self.camera = None;
        // SAFETY: made by `Box::into_raw`; the camera, which called it, is gone.
        drop(unsafe { Box::from_raw(self.painter) });
    }
}

#[expect(unsafe_code, reason = "called by a C library")]
unsafe extern "C" fn paint(buffer: *mut sys::ArvBuffer, painter: *mut c_void, _: u32, _: u32, _: sys::ArvPixelFormat) {
    let mut size = 0;
    // SAFETY: the buffer is being filled by the caller and nobody else; the painter lives, see `FakeCamera::of`.
    let (pixels, painter) = unsafe {
        let data = sys::arv_buffer_get_data(buffer, &raw mut size);
        (std::slice::from_raw_parts_mut(data, size), &mut *painter.cast::<Painter>())
    };
    painter(pixels);
}
