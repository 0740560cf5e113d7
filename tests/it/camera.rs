//! `cellcal camera` on simulated cameras: what people see who mount them.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use cellcal::cv::codec;
use cellcal::vision;
use serde_json::Value;

use crate::support::{expect, json, stderr, text};

/// `cells/sim.yaml` with a change, in a folder of its own.
fn changed(from: &str, to: &str) -> (tempfile::TempDir, std::path::PathBuf) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let cell = std::fs::read_to_string(root.join("cells/sim.yaml")).unwrap();
    assert!(cell.contains(from), "cells/sim.yaml has changed");
    let cell = cell.replace(from, to).replace("../trajectories", text(&root.join("trajectories")));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cell.yaml");
    std::fs::write(&path, cell).unwrap();
    (folder, path)
}

fn board() -> cellcal::board::Board {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("cells/sim.yaml")).unwrap();
    cellcal::config::parse_cell(&text, "sim.yaml").unwrap().board
}

#[test]
fn a_grab_gives_images_events_and_aids() {
    let folder = tempfile::tempdir().unwrap();
    let told = json(&expect(0, &["camera", "grab", "cells/sim.yaml", "--json", "-o", text(folder.path())]));
    for (camera, width, height) in [("rgb", 1380, 780), ("event", 1280, 720)] {
        let aids = &told["cameras"][camera]["aids"];
        assert_eq!((&aids["corners"], &aids["expected"]), (&24.into(), &24.into()), "{told:#}");
        let png = std::fs::read(folder.path().join(format!("{camera}.png"))).unwrap();
        let image = codec::decode_gray(&png).unwrap();
        assert_eq!((image.width, image.height), (width, height));
        let view = match camera {
            "rgb" => vision::frame_view(&board(), &image),
            _ => vision::event_view(&board(), &image),
        };
        assert_eq!(view.unwrap().corners.len(), 24, "the file of the {camera} camera");
    }
    let rgb = &told["cameras"]["rgb"]["aids"];
    // Squares end where pixels of the display end, so those widen nothing. The lens blurs by 1 px; it is drawn with a
    // kernel on half pixels (1/16 px2 more) that are means (1/48 px2 more): 1.041 px, 2.668 px from 10 % to 90 %.
    let sigma_px = (1.0 + 1.0 / 16.0 + 1.0 / 48.0_f64).sqrt();
    let drawn_px = 2.0 * 1.2816 * sigma_px;
    // These edges lie along the pixels, so samples are up to 1 px apart, and straight lines between them cut the curve:
    // by nothing to curvature / slope / 8 = 1.2816 / 8 sigma at either end. The median of 72 edges has little noise.
    let cut_px = 2.0 * 1.2816 / (8.0 * sigma_px);
    let width_px = rgb["edge_width_px"].as_f64().unwrap();
    assert!((drawn_px - 0.03..drawn_px + cut_px + 0.03).contains(&width_px), "{width_px} {drawn_px} {cut_px}");
    assert_eq!(rgb["at_255"], 0.0, "white is at about 80");
    let event = &told["cameras"]["event"];
    assert!(event["aids"]["fill"].as_f64().unwrap() > 0.9, "{event:#}");
    assert_eq!(event["window"]["cut_by_triggers"], true);
    let (from, to) = (event["window"]["us"][0].as_i64().unwrap(), event["window"]["us"][1].as_i64().unwrap());
    // From one exposure to the closing edge, 0.1 s by the clock of the host and 12 ppm off by that of the sensor.
    assert!((to - from - 100_000).abs() <= 3, "{from} {to}");

    let info = json(&expect(0, &["events", "info", text(&folder.path().join("event.raw")), "--json"]));
    assert_eq!((&info["width"], &info["height"], &info["format"]), (&1280.into(), &720.into(), &"evt3".into()));
    // The file has what came before the window, too.
    assert!(info["events"].as_u64().unwrap() > event["window"]["events"].as_u64().unwrap());
    // Begin and end of the exposure, and the begin of the next.
    assert_eq!(info["triggers"].as_array().unwrap().len(), 3);
    let rate = event["window"]["events"].as_f64().unwrap() / 0.1 / 1e3;
    assert!((event["aids"]["rate_kev_s"].as_f64().unwrap() / rate - 1.0).abs() < 1e-4);
}

#[test]
fn what_is_wrong_with_a_camera_is_said() {
    let advice = |sim: &str, camera: &str| {
        let (folder, cell) = changed("sim: {seed: 1}", sim);
        let output = expect(3, &["camera", "grab", text(&cell), "--camera", camera, "-o", text(folder.path())]);
        String::from_utf8(output.stdout).unwrap()
    };
    let bright = advice("sim: {seed: 1, frame: {white_dn: 600}}", "rgb");
    assert!(bright.contains("-> close the iris") && !bright.contains("event"), "{bright}");
    let dark = advice("sim: {seed: 1, frame: {white_dn: 12}}", "rgb");
    assert!(dark.contains("-> open the iris or expose longer"), "{dark}");
    let frozen = advice("sim: {seed: 1, display: {frozen: true}}", "event");
    assert!(frozen.contains("0 of 24") && frozen.contains("see that it blinks"), "{frozen}");
}

#[test]
fn nothing_that_is_no_terminal_gets_live_pictures() {
    let refused = expect(2, &["camera", "stream", "cells/sim.yaml"]);
    assert!(refused.stdout.is_empty() && stderr(&refused).contains("stdout is no terminal"), "{}", stderr(&refused));
    let once = expect(0, &["camera", "stream", "cells/sim.yaml", "--images", "1", "--protocol", "half-blocks"]);
    let printed = String::from_utf8(once.stdout).unwrap();
    assert!(printed.contains("corners 24 of 24"), "{printed}");
    assert!(!printed.contains("\x1b[?"), "the screen is left alone");
    let none = unheard(&["camera", "grab", "cells/ur5e.yaml"]);
    assert!([2, 6].contains(&none.status.code().unwrap()), "{}", stderr(&none));
}

/// The program in a network of its own: it asks for GenICam cameras by broadcast.
fn unheard(arguments: &[&str]) -> std::process::Output {
    let root = Command::new("id").arg("-u").output().unwrap().stdout == b"0\n";
    let mut command = Command::new("unshare");
    command.current_dir(env!("CARGO_MANIFEST_DIR")).arg(if root { "-n" } else { "-rn" });
    command.arg(env!("CARGO_BIN_EXE_cellcal")).args(arguments).output().unwrap()
}

#[test]
fn every_driver_is_listed() {
    let listed = unheard(&["camera", "list", "--json"]);
    assert_eq!(listed.status.code(), Some(0), "{}", stderr(&listed));
    let told = json(&listed);
    let drivers: Vec<_> = told["drivers"].as_array().unwrap().iter().map(|d| d["driver"].as_str().unwrap()).collect();
    assert_eq!(drivers, ["genicam", "v4l2", "folder", "video", "sim", "evk4", "file", "sim"]);
    for driver in told["drivers"].as_array().unwrap() {
        let helped = driver["built_in"] == true || driver["note"].as_str().is_some_and(|note| note.len() > 20);
        assert!(helped, "{driver}");
    }
    let printed = String::from_utf8(unheard(&["camera", "list"]).stdout).unwrap();
    assert_eq!(printed.lines().filter(|line| line.starts_with("event")).count(), 3, "{printed}");
}

/// The program with a page, and where that is.
fn streaming(images: &str) -> (std::process::Child, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_cellcal"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["camera", "stream", "cells/sim.yaml", "--in", "browser", "--listen", "127.0.0.1:0", "--images", images])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut url = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut url).unwrap();
    (child, url.trim().strip_prefix("http://").unwrap().to_owned())
}

fn ask(address: &str, path: &str) -> BufReader<TcpStream> {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(120))).unwrap();
    write!(stream, "GET {path} HTTP/1.0\r\nHost: {address}\r\n\r\n").unwrap();
    BufReader::new(stream)
}

/// Everything that a plain client gets, as the images of a multipart response.
fn parts(reader: &mut impl std::io::BufRead) -> Vec<Vec<u8>> {
    let (mut parts, mut line, mut length) = (Vec::new(), String::new(), None);
    loop {
        line.clear();
        if reader.read_line(&mut line).unwrap() == 0 {
            return parts;
        }
        if let Some(bytes) = line.strip_prefix("Content-Length: ") {
            length = Some(bytes.trim().parse().unwrap());
        }
        // The empty line ends the head of a part.
        if let Some(bytes) = length.filter(|_| line == "\r\n") {
            let mut part = vec![0; bytes];
            reader.read_exact(&mut part).unwrap();
            parts.push(part);
            length = None;
        }
    }
}

#[test]
fn a_browser_gets_images_with_corners_and_aids() {
    let (mut child, address) = streaming("3");
    let page = ask(&address, "/").lines().map_while(Result::ok).collect::<String>();
    assert!(page.contains("/page.js"), "{page}");
    let mut event = ask(&address, "/event.mjpeg");
    let of_event = std::thread::spawn(move || parts(&mut event));
    let of_rgb = parts(&mut ask(&address, "/rgb.mjpeg"));
    for (parts, width, height) in [(of_rgb, 1380, 780), (of_event.join().unwrap(), 1280, 720)] {
        assert!((1..=3).contains(&parts.len()), "{}", parts.len());
        for part in &parts {
            let image = codec::decode_color(part).unwrap();
            assert_eq!((image.width, image.height), (width, height));
            let green = image.pixels.iter().filter(|[r, g, b]| *g > 150 && *r < 90 && *b < 190).count();
            // 24 crosses of 2 x 17 px; JPEG dims the colour of thin lines.
            assert!(green > 200, "{green} pixels of corners");
        }
    }
    assert!(child.wait().unwrap().success());
}

#[test]
fn an_interrupted_stream_ends_well_and_its_aids_are_those_of_the_image() {
    let (mut child, address) = streaming("1000000");
    let mut rgb = ask(&address, "/rgb.mjpeg");
    let mut line = String::new();
    while !line.starts_with("Content-Length") {
        line.clear();
        assert_ne!(rgb.read_line(&mut line).unwrap(), 0);
    }
    let told: String =
        ask(&address, "/aids.json").lines().map_while(Result::ok).skip_while(|l| !l.is_empty()).collect();
    let told: Value = serde_json::from_str(&told).unwrap();
    assert_eq!(told["shown"]["cameras"]["rgb"]["readings"][0]["value"], "24 of 24", "{told:#}");
    let stopped = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(stopped.success());
    assert_eq!(child.wait().unwrap().code(), Some(0));
}
