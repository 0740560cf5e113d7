//! The GenICam driver against a real GigE Vision camera on the loopback: Aravis's own, in this process.

#![expect(clippy::disallowed_methods, reason = "waits for a camera that keeps real time")]

mod fake;
mod session;

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use cellcal::config::{FrameCameraCell, FrameTrigger, parse_cell};
use cellcal::devices::genicam::{self, list};
use cellcal::devices::{CameraError, FrameCamera, FrameImage, WallClock};
use cellcal::session::Stamp;
use fake::{FakeCamera, alone};

use crate::support::{expect, json, stderr, text};

const SIZE: [usize; 2] = [1380, 780];

/// The frame camera of a cell with some other values.
fn camera(change: impl FnOnce(&mut FrameCameraCell)) -> FrameCameraCell {
    let shipped = include_str!("../../../cells/sim.yaml");
    let text = shipped.replacen("  driver: sim\n  serial: SIM-RGB", "  driver: genicam\n  serial: GVTEST", 1);
    let mut camera = parse_cell(&text, "cell").unwrap().rgb.unwrap();
    (camera.exposure_s, camera.images_per_s) = (0.04, 20.0);
    change(&mut camera);
    camera
}

fn open(cell: &FrameCameraCell) -> Box<dyn FrameCamera> {
    genicam::open(cell, Arc::new(WallClock::starting_at(Stamp::default()))).unwrap()
}

fn refused(cell: &FrameCameraCell) -> String {
    match genicam::open(cell, Arc::new(WallClock::starting_at(Stamp::default()))) {
        Ok(_) => panic!("the camera was opened"),
        Err(error) => error.to_string(),
    }
}

/// A camera each of whose images has the number of its exposure in all pixels.
fn counting(serial: &str) -> (FakeCamera, Arc<AtomicU32>) {
    let made = Arc::new(AtomicU32::new(0));
    let count = Arc::clone(&made);
    let painter = move |pixels: &mut [u8]| pixels.fill(count.fetch_add(1, Ordering::SeqCst) as u8);
    (FakeCamera::new(serial, painter), made)
}

/// Polls until the camera answers; the test ends where it never does.
fn wait(camera: &mut dyn FrameCamera) -> Result<Vec<FrameImage>, CameraError> {
    let patient = Instant::now() + Duration::from_secs(60);
    while Instant::now() < patient {
        if let Some(images) = camera.poll()? {
            return Ok(images);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("neither images nor an error");
}

fn capture(camera: &mut dyn FrameCamera, images: u32) -> Vec<FrameImage> {
    camera.begin(images).unwrap();
    wait(camera).unwrap()
}

/// The numbers in the images.
fn numbers(images: &[FrameImage]) -> Vec<u8> {
    let whole = images.iter().filter_map(|i| i.image.as_ref());
    whole
        .map(|image| {
            assert_eq!([image.width, image.height], SIZE);
            assert!(image.pixels.iter().all(|v| *v == image.pixels[0]), "an image is mixed of two");
            image.pixels[0]
        })
        .collect()
}

#[test]
fn cameras_are_found_and_opened_by_serial() {
    alone("cameras_are_found_and_opened_by_serial", || {
        assert_eq!(list(), []);
        let nobody = refused(&camera(|_| {}));
        assert!(nobody.starts_with("no GenICam camera has the serial number GVTEST; none answers"), "{nobody}");
        let (_fake, _) = counting("GVTEST");
        let found = list();
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].serial.as_str(), found[0].address.as_str()), ("GVTEST", "127.0.0.1"));
        let printed = json(&expect(0, &["camera", "list", "--json"]));
        assert_eq!(printed["drivers"][0]["cameras"][0]["serial"], "GVTEST");

        let other = refused(&camera(|c| c.serial = Some("OTHER".into())));
        assert!(
            other.contains("serial number OTHER; these answer: ") && other.contains("GVTEST at 127.0.0.1"),
            "{other}"
        );
        let first = open(&camera(|c| c.serial = None));
        assert_eq!(first.facts().serial.as_deref(), Some("GVTEST"));
        let busy = refused(&camera(|_| {}));
        assert!(busy.contains("controlled by another program"), "{busy}");
        drop(first);
        drop(open(&camera(|_| {})));
    });
}

#[test]
fn settings_are_read_back_and_what_cannot_be_is_refused() {
    alone("settings_are_read_back_and_what_cannot_be_is_refused", || {
        let (_fake, _) = counting("GVTEST");
        let opened = open(&camera(|c| (c.gain, c.offset_px) = (Some(3.0), Some([100, 60]))));
        assert_eq!(opened.size(), SIZE.map(|n| n as u32));
        let settings = opened.facts().settings;
        let expected = [
            ("pixel_format", "Mono8"),
            ("offset_px", "100, 60"),
            ("size_px", "1380 x 780"),
            ("exposure_s", "0.04"),
            ("gain", "3"),
            ("images_per_s", "20"),
            ("trigger", "free run"),
            ("protocol", "GigEVision"),
        ];
        for (name, value) in expected {
            assert_eq!(settings.get(name).map(String::as_str), Some(value), "{name} of {settings:#?}");
        }
        drop(opened);
        // The sensor has 2048 columns and rows.
        let middle = open(&camera(|c| c.trigger = FrameTrigger::Software)).facts().settings;
        assert_eq!((middle["offset_px"].as_str(), middle["trigger"].as_str()), ("334, 634", "Software"));

        let wrong = refused(&camera(|c| c.width = 3000));
        assert!(wrong.starts_with("rgb.width is 3000, but the camera takes 1 to 2048"), "{wrong}");
        let wrong = refused(&camera(|c| c.gain = Some(99.0)));
        assert_eq!(wrong, "rgb.gain is 99, but the camera takes 0 to 10");
        let wrong = refused(&camera(|c| c.exposure_s = 11.0));
        assert!(wrong.starts_with("rgb.exposure_s is 11, but the camera takes 0.00001 to 10"), "{wrong}");
        let by = |line: &str| {
            refused(&camera(|c| {
                (c.trigger, c.trigger_line) = (FrameTrigger::RobotOutput(3), Some(line.into()));
            }))
        };
        assert_eq!(by("Line7"), "rgb.trigger_line is Line7, but the camera has Line0, Software");
        let wrong = refused(&camera(|c| c.exposure_line = Some("Line2".into())));
        assert_eq!(wrong, "rgb.exposure_line is Line2, but the camera has no LineSource");
    });
}

#[test]
fn free_running_the_next_exposures_arrive_in_order() {
    alone("free_running_the_next_exposures_arrive_in_order", || {
        let (_fake, made) = counting("GVTEST");
        let mut camera = open(&camera(|_| {}));
        for images in [1_u32, 3, 5] {
            let before = made.load(Ordering::SeqCst);
            let taken = capture(&mut *camera, images);
            assert!(taken.iter().all(|i| i.exposure.image && !i.exposure.closing && i.exposure.lost_packets == 0));
            let numbers = numbers(&taken);
            assert_eq!(numbers.len(), images as usize);
            assert!(numbers.windows(2).all(|pair| pair[1] == pair[0].wrapping_add(1)), "{numbers:?}");
            assert!(u32::from(numbers[0]) + 1 >= before, "image {} was made before the capture began", numbers[0]);
            for pair in taken.windows(2) {
                let apart_s = pair[1].exposure.start_s - pair[0].exposure.start_s;
                // A camera in a process on a busy machine is not punctual; its stamps say so.
                assert!(apart_s > 0.02, "{apart_s} s from one exposure to the next");
            }
        }
    });
}

#[test]
fn a_command_begins_each_exposure_and_one_more_closes() {
    alone("a_command_begins_each_exposure_and_one_more_closes", || {
        let (_fake, made) = counting("GVTEST");
        let mut camera = open(&camera(|c| c.trigger = FrameTrigger::Software));
        for first in [0_u8, 3, 6] {
            let taken = capture(&mut *camera, 2);
            assert_eq!(numbers(&taken), [first, first + 1]);
            assert_eq!(taken.iter().map(|i| i.exposure.closing).collect::<Vec<_>>(), [false, false, true]);
            let starts: Vec<f64> = taken.iter().map(|i| i.exposure.start_s).collect();
            // Whether the camera rests for a whole period is tested without it: a first image that comes late shifts the
            // stamps of this one against the next. What is left is the period of 0.05 s less the exposure of 0.04 s.
            assert!(starts.windows(2).all(|pair| pair[1] - pair[0] > 0.009), "the camera rests: {starts:?}");
        }
        assert_eq!(made.load(Ordering::SeqCst), 9, "nothing is exposed without a command");
        assert!(!camera.wants_pulse());
    });
}

#[test]
fn a_pulse_is_asked_for_where_the_robot_triggers() {
    alone("a_pulse_is_asked_for_where_the_robot_triggers", || {
        let (fake, made) = counting("GVTEST");
        let mut camera = open(&camera(|c| c.trigger = FrameTrigger::RobotOutput(3)));
        assert_eq!(camera.facts().settings["trigger"], "Line0");
        assert!(!camera.wants_pulse(), "no capture, no pulse");
        camera.begin(2).unwrap();
        assert!(camera.wants_pulse() && !camera.wants_pulse(), "one pulse at a time");
        let unwired = wait(&mut *camera).unwrap_err().to_string();
        assert!(unwired.contains("digital output 3 of the robot; is that output wired to Line0?"), "{unwired}");

        fake.connect_line();
        camera.begin(2).unwrap();
        let taken = loop {
            if camera.wants_pulse() {
                fake.pulse();
            }
            if let Some(taken) = camera.poll().unwrap() {
                break taken;
            }
        };
        assert_eq!(taken.iter().map(|i| i.exposure.closing).collect::<Vec<_>>(), [false, false, true]);
        assert_eq!(numbers(&taken), [0, 1]);
        assert_eq!(made.load(Ordering::SeqCst), 3, "one exposure a pulse");
    });
}

#[test]
fn lost_packets_are_told_with_their_exposure() {
    alone("lost_packets_are_told_with_their_exposure", || {
        let (fake, _) = counting("GVTEST");
        let mut camera = open(&camera(|_| {}));
        assert_eq!(numbers(&capture(&mut *camera, 2)).len(), 2);
        fake.lose(0.3);
        let mut broken = Vec::new();
        for _ in 0..20 {
            camera.begin(3).unwrap();
            // Where the first packets are lost too, nothing at all may arrive for a while.
            let taken = wait(&mut *camera).unwrap_or_default();
            assert!(taken.iter().all(|i| i.exposure.image == i.image.is_some()));
            broken.extend(taken.into_iter().filter(|i| i.exposure.lost_packets > 0));
            if broken.len() >= 3 {
                break;
            }
        }
        assert!(broken.len() >= 3 && broken.iter().all(|i| !i.exposure.image), "{} broken images", broken.len());
        fake.lose(0.0);
        let again = (0..5).find_map(|_| {
            camera.begin(2).unwrap();
            wait(&mut *camera).ok().filter(|taken| numbers(taken).len() == 2)
        });
        assert!(again.is_some(), "the camera does not recover");
    });
}

#[test]
fn a_camera_that_disappears_is_told() {
    alone("a_camera_that_disappears_is_told", || {
        let (fake, _) = counting("GVTEST");
        let mut free = open(&camera(|_| {}));
        assert_eq!(numbers(&capture(&mut *free, 1)).len(), 1);
        free.begin(2).unwrap();
        drop(fake);
        let silent = wait(&mut *free).unwrap_err().to_string();
        assert!(silent.contains("delivered nothing for") && silent.contains("is it connected and powered"), "{silent}");
        // Aravis gives the connection up after some seconds.
        let gone = (0..30).find_map(|_| {
            std::thread::sleep(Duration::from_millis(500));
            free.begin(1).err().map(|error| error.to_string())
        });
        assert!(gone.as_ref().is_some_and(|why| why.contains("does not answer any more")), "{gone:?}");
    });
}

/// Features of the fake camera with some more in the place of `TestBoolean`; registers at addresses of no other use.
fn features(folder: &std::path::Path) -> std::path::PathBuf {
    use aravis::prelude::{CameraExt as _, DeviceExt as _};
    let (fake, _) = counting("PLAIN");
    let plain = aravis::Camera::new(None).unwrap();
    let (xml, _) = plain.device().unwrap().genicam_xml();
    drop((plain, fake));
    let register = |name: &str, address: u32| {
        format!(
            "<IntReg Name=\"{name}Register\" NameSpace=\"Custom\"><Address>{address:#x}</Address><Length>4</Length>\
         <AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
        )
    };
    let choice = |name: &str, entries: &[&str], address: u32| {
        let entry = |(i, entry): (usize, &&str)| format!("<EnumEntry Name=\"{entry}\"><Value>{i}</Value></EnumEntry>");
        let entries: String = entries.iter().enumerate().map(entry).collect();
        let register = register(name, address);
        format!("<Enumeration Name=\"{name}\">{entries}<pValue>{name}Register</pValue></Enumeration>{register}")
    };
    let more = [
        choice("LineSelector", &["Line0", "Line1", "Line2"], 0x5000),
        choice("LineMode", &["Output", "Input"], 0x5004),
        choice("LineSource", &["Off", "ExposureActive"], 0x5008),
    ];
    assert!(xml.contains("</RegisterDescription>"));
    let xml = xml.replace("</RegisterDescription>", &format!("{}</RegisterDescription>", more.concat()));
    let path = folder.join("features.xml");
    std::fs::write(&path, xml).unwrap();
    path
}

#[test]
fn the_exposure_signal_is_put_on_an_output() {
    alone("the_exposure_signal_is_put_on_an_output", || {
        let folder = tempfile::tempdir().unwrap();
        let _fake = FakeCamera::with_features("GVTEST", &features(folder.path()));
        let line = |cell: &FrameCameraCell| open(cell).facts().settings["exposure_line"].clone();
        assert_eq!(line(&camera(|_| {})), "Line0", "the first output");
        assert_eq!(line(&camera(|c| c.trigger = FrameTrigger::RobotOutput(1))), "Line1", "not the trigger input");
        assert_eq!(line(&camera(|c| c.exposure_line = Some("Line2".into()))), "Line2");
        assert_eq!(line(&camera(|c| c.wired = false)), "not wanted");
        let wrong = refused(&camera(|c| c.exposure_line = Some("Line9".into())));
        assert!(
            wrong.starts_with("rgb.exposure_line is Line9, but the camera cannot show its exposures there"),
            "{wrong}"
        );
    });
}

#[test]
fn the_program_says_what_is_wrong_with_a_camera() {
    alone("the_program_says_what_is_wrong_with_a_camera", || {
        let folder = tempfile::tempdir().unwrap();
        let cell = folder.path().join("cell.yaml");
        std::fs::write(&cell, session::cell_text()).unwrap();
        let sessions = folder.path().join("sessions");
        let refused = expect(6, &["run", text(&cell), "-o", text(&sessions)]);
        assert!(
            stderr(&refused).contains("frame camera: no GenICam camera has the serial number"),
            "{}",
            stderr(&refused)
        );
        let refused = expect(2, &["run", text(&cell), "--time-scale", "max", "-o", text(&sessions)]);
        assert!(stderr(&refused).contains("keeps real time"), "{}", stderr(&refused));
        assert!(!sessions.exists(), "a session that never began is recorded");
    });
}
