//! Bags of others: made here with the library and messages encoded by hand, never with our own writer.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use cellcal::calibration::settings::PoseKind;
use cellcal::config::{parse_cell, parse_trajectory};
use cellcal::devices::sim::cell::SimCell;
use cellcal::events::{Decoder, Encoder, Event, Format, Trigger};
use cellcal::geometry::kinematics::{Arm, Joints, UR_JOINTS};
use cellcal::geometry::{Base, Flange, Transform};
use cellcal::image::GrayImage;
use cellcal::plan;
use cellcal::recording::{Entry, Recording};
use rayon::prelude::*;

use crate::support::{cellcal, data, expect, json, number, rotation, stderr, text, vector};

/// A clock as real ones are, s.
const HOST_S: f64 = 1_700_000_000.0;
/// The sensor's clock is ahead of the stamps by this, s.
const SENSOR_AHEAD_S: f64 = 31.25;
/// EVT3 counts 24 bits of microseconds, and nobody can tell how often it has wrapped before the first packet, s.
const SENSOR_WRAP_S: f64 = 16.777_216;
/// From one stop to the next, s; the arm moves during the first third.
const LEG_S: f64 = 1.5;
const EXPOSURE_S: f64 = 0.0999;
/// Two images at each stop, seconds into its leg.
const IMAGES_S: [f64; 2] = [0.9, 1.0];
/// One in the middle of each move, too.
const MOVING_S: f64 = 0.2;

/// What the cameras of the simulated cell see of some poses.
struct Scene {
    joints: Vec<Joints>,
    /// Time, image and events of each exposure.
    shots: Vec<(f64, GrayImage, Vec<Event>)>,
    base_from_event: Transform<Base, cellcal::geometry::Event>,
    event_from_rgb: Transform<cellcal::geometry::Event, cellcal::geometry::Rgb>,
}

fn read(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

fn scene() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| {
        let cell = parse_cell(&read("cells/sim.yaml"), "cells/sim.yaml").unwrap();
        let trajectory = parse_trajectory(&read("trajectories/hand-eye-22.yaml"), "hand-eye-22.yaml").unwrap();
        let plan = plan::expand(&cell, &[(PoseKind::HandEye, trajectory)]).unwrap();
        let joints: Vec<Joints> = plan.poses.iter().step_by(2).map(|pose| pose.joints_rad).collect();
        let sim = SimCell::start(&cell, None, f64::INFINITY).unwrap();
        let (world, placement) = (sim.scene(), sim.truth.placement);
        let look = |(i, at_s): (usize, f64)| {
            let base_from_flange: Transform<Base, Flange> = Arm::ur5e().forward(&joints[i]);
            let start_s = LEG_S * i as f64 + at_s;
            let event_from_target = placement.event_from_target(base_from_flange);
            let rgb_from_target = placement.rgb_from_target(base_from_flange);
            let events = world.events(&event_from_target, start_s, start_s + 0.1);
            (start_s, world.expose(&rgb_from_target, start_s, EXPOSURE_S), events)
        };
        let all: Vec<_> = (0..joints.len()).flat_map(|i| IMAGES_S.map(|at_s| (i, at_s))).collect();
        let shots = all.into_par_iter().map(look).collect();
        let (base_from_event, event_from_rgb) = (sim.truth.mount_of_camera, sim.truth.event_from_rgb);
        let base_from_event = Transform::assume_frames(*base_from_event.iso());
        Scene { joints, shots, base_from_event, event_from_rgb }
    })
}

/// Little-endian CDR, as the specification has it; alignment counts from behind the first four bytes.
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn put<const N: usize>(mut self, bytes: [u8; N]) -> Self {
        self.0.resize(4 + (self.0.len() - 4).next_multiple_of(N), 0);
        self.0.extend(bytes);
        self
    }

    fn u32(self, value: u32) -> Self {
        self.put(value.to_le_bytes())
    }

    fn f64(self, value: f64) -> Self {
        self.put(value.to_le_bytes())
    }

    fn text(self, text: &str) -> Self {
        let mut cdr = self.u32(text.len() as u32 + 1);
        cdr.0.extend(text.as_bytes());
        cdr.0.push(0);
        cdr
    }

    fn bytes(self, bytes: &[u8]) -> Self {
        let mut cdr = self.u32(bytes.len() as u32);
        cdr.0.extend(bytes);
        cdr
    }

    fn header(self, at_s: f64, frame: &str) -> Self {
        let ns = stamp_ns(at_s);
        self.u32((ns / 1_000_000_000) as u32).u32((ns % 1_000_000_000) as u32).text(frame)
    }
}

fn stamp_ns(at_s: f64) -> u64 {
    (HOST_S as u64) * 1_000_000_000 + (at_s * 1e9).round() as u64
}

fn image(at_s: f64, image: &GrayImage, encoding: &str) -> Vec<u8> {
    let channels = if encoding == "mono8" { 1 } else { 3 };
    let pixels: Vec<u8> = image.pixels.iter().flat_map(|p| std::iter::repeat_n(*p, channels)).collect();
    let head = Cdr::new().header(at_s, "camera").u32(image.height as u32).u32(image.width as u32).text(encoding);
    head.put([0]).u32((image.width * channels) as u32).bytes(&pixels).0
}

fn packet(at_s: f64, number: u64, encoding: &str, words: &[u8]) -> Vec<u8> {
    let head = Cdr::new().header(at_s, "event").u32(720).u32(1280).put(number.to_le_bytes()).put(0_u64.to_le_bytes());
    head.text(encoding).put([0]).bytes(words).0
}

/// As some drivers do it: in the order of the alphabet, with a gripper.
fn joint_state(at_s: f64, joints: &Joints, speed_rad_s: f64) -> Vec<u8> {
    let mut named: Vec<(&str, f64)> = UR_JOINTS.iter().copied().zip(*joints).collect();
    named.push(("gripper_joint", 0.02));
    named.sort_unstable_by_key(|(name, _)| *name);
    let mut cdr = Cdr::new().header(at_s, "").u32(named.len() as u32);
    for (name, _) in &named {
        cdr = cdr.text(name);
    }
    cdr = cdr.u32(named.len() as u32);
    for (_, position) in &named {
        cdr = cdr.f64(*position);
    }
    cdr = cdr.u32(named.len() as u32);
    for _ in &named {
        cdr = cdr.f64(speed_rad_s);
    }
    cdr.u32(0).0
}

fn tf(at_s: f64, steps: &[(&str, &str, nalgebra::Isometry3<f64>)]) -> Vec<u8> {
    let mut cdr = Cdr::new().u32(steps.len() as u32);
    for (parent, child, pose) in steps {
        cdr = cdr.header(at_s, parent).text(child);
        for number in pose.translation.vector.iter().chain(pose.rotation.coords.iter()) {
            cdr = cdr.f64(*number);
        }
    }
    cdr.0
}

/// Time, topic, schema and bytes of a message.
type Sent = (f64, &'static str, &'static str, Vec<u8>);

const IMAGE: &str = "sensor_msgs/msg/Image";
const PACKET: &str = "event_camera_msgs/msg/EventPacket";
const JOINTS: &str = "sensor_msgs/msg/JointState";
const TF: &str = "tf2_msgs/msg/TFMessage";

fn bag(mut messages: Vec<Sent>) -> Vec<u8> {
    messages.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut bytes = Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(1 << 20)).library("somebody's recorder");
    let mut writer = options.create(&mut bytes).unwrap();
    let mut channels = BTreeMap::new();
    for (number, (at_s, topic, schema, data)) in messages.into_iter().enumerate() {
        let channel_id = *channels.entry(topic).or_insert_with(|| {
            let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
            writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
        });
        // Logged a little after its stamp.
        let log_time = stamp_ns(at_s + 0.003);
        let header =
            mcap::records::MessageHeader { channel_id, sequence: number as u32, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

fn images(encoding: &str) -> Vec<Sent> {
    let shots = scene().shots.iter();
    let mut sent: Vec<Sent> =
        shots.map(|(at_s, gray, _)| (*at_s, "/camera/image_raw", IMAGE, image(*at_s, gray, encoding))).collect();
    // On the way to each stop; black, so that it cannot be mistaken for a view.
    let black = GrayImage::filled(1380, 780, 0);
    sent.extend((1..scene().joints.len()).map(|i| {
        let at_s = LEG_S * i as f64 + MOVING_S;
        (at_s, "/camera/image_raw", IMAGE, image(at_s, &black, encoding))
    }));
    sent
}

/// The packets of each stop, with the edges of exposures or without.
fn packets(with_edges: bool) -> Vec<Sent> {
    let us = |at_s: f64| ((at_s + SENSOR_AHEAD_S) * 1e6).round() as i64;
    let mut triggers = Vec::new();
    let starts = scene().shots.iter().map(|shot| shot.0);
    let moving = (1..scene().joints.len()).map(|i| LEG_S * i as f64 + MOVING_S);
    for at_s in starts.chain(moving) {
        triggers.push(Trigger { t_us: us(at_s), channel: 0, rising: true });
        triggers.push(Trigger { t_us: us(at_s + EXPOSURE_S), channel: 0, rising: false });
    }
    triggers.sort_by_key(|t| t.t_us);
    let ahead_us = (SENSOR_AHEAD_S * 1e6) as i64;
    let events = scene().shots.iter().flat_map(|shot| shot.2.iter());
    let mut events: Vec<Event> = events.map(|e| Event { t_us: e.t_us + ahead_us, ..*e }).collect();
    events.sort_by_key(|e| e.t_us);
    let (mut encoder, mut sent) = (Encoder::new(Format::Evt3), Vec::new());
    let total_s = LEG_S * scene().joints.len() as f64;
    for number in 0..(total_s / 0.02) as u64 {
        let until_s = 0.02 * (number + 1) as f64;
        let split = events.partition_point(|e| e.t_us < us(until_s));
        let later = events.split_off(split);
        let now = std::mem::replace(&mut events, later);
        let split = triggers.partition_point(|t| t.t_us < us(until_s));
        let later = triggers.split_off(split);
        let edges = std::mem::replace(&mut triggers, later);
        let mut words = Vec::new();
        encoder.encode(&now, if with_edges { &edges } else { &[] }, &mut words).unwrap();
        // A latency of 2 ms and up to 3 more.
        let at_s = until_s + 0.002 + 0.001 * (number * 7 % 4) as f64;
        sent.push((at_s, "/event_camera/events", PACKET, packet(at_s, number, "evt3", &words)));
    }
    sent
}

/// Joints and their speed: on the way for a third of each leg, then still but for the noise of encoders.
fn arm_at(at_s: f64) -> (Joints, f64) {
    let leg = ((at_s / LEG_S) as usize).min(scene().joints.len() - 1);
    let joints = &scene().joints;
    let (from, to) = (&joints[leg.saturating_sub(1)], &joints[leg]);
    let part = ((at_s - LEG_S * leg as f64) / (LEG_S / 3.0)).clamp(0.0, 1.0);
    let noise = 2e-5 * ((at_s * 50.0).round() * 2.399).sin();
    let moving = part < 1.0 && leg > 0;
    (std::array::from_fn(|i| from[i] + part * (to[i] - from[i]) + noise), if moving { 0.3 } else { 2e-4 })
}

fn times() -> impl Iterator<Item = f64> {
    (0..(LEG_S * scene().joints.len() as f64 * 50.0) as u32).map(|n| f64::from(n) / 50.0)
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn map() -> String {
    read("tests/maps/joints.yaml")
}

/// The map for transforms instead of joints.
fn map_tf() -> String {
    let (before, after) = map().split_once("robot:\n").map(|(a, b)| (a.to_owned(), b.to_owned())).unwrap();
    let stops = after.split_once("stops:\n").unwrap().1;
    format!("{before}robot:\n  tf: {{base: base, tcp: tool0}}\nstops:\n{stops}")
}

fn import(folder: &Path, bag: &Path, map: &str) -> (std::process::Output, PathBuf) {
    let map = write(folder, "topics.yaml", map.as_bytes());
    let session = folder.join("session.mcap");
    (cellcal(&["import", text(bag), "--map", text(&map), "-o", text(&session), "--force", "--json"]), session)
}

/// Both cameras, stereo and hand-eye against the truth.
fn check_result(result: &serde_json::Value) {
    let truth = scene();
    // What the simulator is held to for the paper's method, with one image a pose; the mean of two has less noise, at
    // best by the square root of two.
    for (camera, low, high) in [("rgb", 0.08, 0.20), ("event", 0.35, 0.60)] {
        let found = number(result, &format!("/cameras/{camera}/rms_px"));
        assert!((low / 2.0_f64.sqrt()..high).contains(&found), "{camera}: {found}");
    }
    // As for sessions of our own: an independent model has median errors of 2.6 mm in stereo and 5.0 mm in hand-eye
    // with 39 poses, and published rotations scatter by 0.285 deg; three times that, and more for fewer poses.
    let wide = 3.0 * (39.0 / truth.joints.len() as f64).sqrt();
    let off_m =
        (vector(result, "/stereo/event_from_rgb/translation_m") - truth.event_from_rgb.iso().translation.vector).norm();
    let turned = rotation(result, "/stereo/event_from_rgb/quaternion_xyzw").angle_to(&truth.event_from_rgb.rotation());
    let hand_m = (vector(result, "/hand_eye/base_from_camera/translation_m")
        - truth.base_from_event.iso().translation.vector)
        .norm();
    let hand_turned =
        rotation(result, "/hand_eye/base_from_camera/quaternion_xyzw").angle_to(&truth.base_from_event.rotation());
    eprintln!(
        "stereo {:.2} mm {:.3} deg, hand-eye {:.2} mm {:.3} deg from the truth",
        off_m * 1e3,
        turned.to_degrees(),
        hand_m * 1e3,
        hand_turned.to_degrees()
    );
    assert!(off_m < wide * 2.6e-3 && turned.to_degrees() < wide * 0.285, "{off_m} {turned}");
    assert!(hand_m < wide * 5.0e-3 && hand_turned.to_degrees() < wide * 0.285, "{hand_m} {hand_turned}");
}

#[test]
fn a_bag_with_joints_and_edges_is_solved() {
    let folder = tempfile::tempdir().unwrap();
    let mut messages = [images("mono8"), packets(true)].concat();
    messages.extend(times().map(|at_s| {
        let (joints, speed) = arm_at(at_s);
        (at_s, "/joint_states", JOINTS, joint_state(at_s, &joints, speed))
    }));
    let whole = bag(messages);
    let path = write(folder.path(), "bag.mcap", &whole);
    let (output, session) = import(folder.path(), &path, &map());
    assert!(output.status.success(), "{}", stderr(&output));
    let report = json(&output);
    let stops = scene().joints.len();
    assert_eq!((report["poses"].as_u64(), report["images"].as_u64()), (Some(stops as u64), Some(2 * stops as u64)));
    let replayed = expect(3, &["replay", text(&session), "--json", "--set", "settings.method=paper"]);
    let result = json(&replayed);
    let (timing, exposures) = (&result["timing"], 3 * stops - 1);
    assert_eq!(
        (&timing["paired_by"], &timing["windows"]),
        (&"trigger".into(), &serde_json::json!([exposures, exposures]))
    );
    // Stamps and edges are of one scene but for the microseconds that the sensor counts in.
    assert!(number(&result, "/timing/residual_rms_s") < 2e-6, "{timing:#}");
    check_result(&result);
    // The poses are those of the joints but for noise: six joints, each at most 2e-5 rad off and 1 m away.
    for (pose, joints) in result["poses"].as_array().unwrap().iter().zip(&scene().joints) {
        let found: Transform<Base, cellcal::geometry::Tcp> =
            serde_json::from_value(pose["base_from_tcp"].clone()).unwrap();
        let offset = Transform::<Flange, cellcal::geometry::Tcp>::from_pose_vector([0.0, 0.0, 0.04, 0.0, 0.0, 0.0]);
        let off_m = found.distance_to_m(&(Arm::ur5e().forward(joints) * offset));
        assert!(off_m < 6.0 * 2e-5, "{off_m}");
    }

    // Cut in the middle: what is there is read, and the loss is said.
    let cut = write(folder.path(), "cut.mcap", &whole[..whole.len() * 6 / 10]);
    let (output, session) = import(folder.path(), &cut, &map());
    let report = json(&output);
    let poses = report["poses"].as_u64().unwrap() as usize;
    assert!((stops / 2 - 1..stops).contains(&poses), "{report:#}");
    assert!(report["notices"].to_string().contains("the bag is damaged: broken off"), "{report:#}");
    let result = json(&expect(3, &["replay", text(&session), "--json", "--set", "settings.method=paper"]));
    assert!(result["provenance"]["facts"]["bag_damage"].as_str().unwrap().starts_with("broken off"));
}

#[test]
fn a_bag_with_transforms_and_no_edges_is_solved_by_its_stamps() {
    let folder = tempfile::tempdir().unwrap();
    let mut messages = [images("bgr8"), packets(false)].concat();
    let half = nalgebra::Isometry3::translation(0.0, 0.0, 0.02);
    let turned = nalgebra::Isometry3::rotation(nalgebra::Vector3::z() * std::f64::consts::PI);
    messages.push((
        0.0,
        "/tf_static",
        TF,
        tf(
            0.0,
            &[("flange", "tool0", nalgebra::Isometry3::translation(0.0, 0.0, 0.04)), ("base_link", "base", turned)],
        ),
    ));
    messages.extend(times().map(|at_s| {
        let base_from_flange = *Arm::ur5e().forward(&arm_at(at_s).0).iso();
        // In two steps, and with a frame that is none of ours.
        let steps =
            [("base", "elbow", base_from_flange * half.inverse()), ("elbow", "flange", half), ("map", "odom", half)];
        (at_s, "/tf", TF, tf(at_s, &steps))
    }));
    let path = write(folder.path(), "bag.mcap", &bag(messages));
    let (output, session) = import(folder.path(), &path, &map_tf());
    assert!(output.status.success(), "{}", stderr(&output));
    let result = json(&expect(3, &["replay", text(&session), "--json", "--set", "settings.method=paper"]));
    assert_eq!(result["timing"]["paired_by"], "arrival", "{:#}", result["timing"]);
    // Late by the fastest packet: 2 ms, and the end of the packet is at most 20 ms after its last event.
    let late_s = number(&result, "/timing/offset_s") + SENSOR_AHEAD_S - SENSOR_WRAP_S;
    assert!((-1e-4..0.0225).contains(&(late_s - late_s.round())), "{late_s}");
    check_result(&result);
}

#[test]
fn what_is_not_understood_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let event_only = map().split("rgb:\n").next().unwrap().replace("mode: handeye ", "mode: stereo ")
        + "event: {topic: /event_camera/events, width: 1280, height: 720}\nstops: {intervals: [{id: all, from_s: 1, to_s: 2e9}]}\n";
    for encoding in ["libcaer", "libcaer_cmp", "mono", "trigger"] {
        let sent = vec![(1.0, "/event_camera/events", PACKET, packet(1.0, 0, encoding, &[0; 8]))];
        let path = write(folder.path(), "bag.mcap", &bag(sent));
        let (output, session) = import(folder.path(), &path, &event_only);
        let said = stderr(&output);
        assert!(said.contains(&format!("encoding `{encoding}`; allowed are evt3, evt2")), "{said}");
        assert!(output.status.code() == Some(1) && !session.exists(), "{said}");
    }
    let images_only = map().split("event:\n").next().unwrap().replace("mode: handeye ", "mode: stereo ")
        + "stops: {each_image: true}\n";
    let gray = GrayImage::filled(1380, 780, 7);
    for (schema, data, words) in [
        (IMAGE, image(1.0, &gray, "bayer_rggb8"), "encoding `bayer_rggb8`; allowed are mono8"),
        (IMAGE, image(1.0, &GrayImage::filled(8, 6, 7), "mono8"), "an image of 8x6, the map says 1380x780"),
        (IMAGE, vec![0, 1, 0, 0, 7], "not what its schema says"),
        (
            "stereo_msgs/msg/DisparityImage",
            vec![],
            "schema `stereo_msgs/msg/DisparityImage` in encoding `cdr`; allowed are",
        ),
    ] {
        let path = write(folder.path(), "bag.mcap", &bag(vec![(1.0, "/camera/image_raw", schema, data)]));
        let said = stderr(&import(folder.path(), &path, &images_only).0);
        assert!(said.contains("topic /camera/image_raw") && said.contains(words), "{said}");
    }
    let path = write(folder.path(), "bag.mcap", &bag(vec![(1.0, "/other", IMAGE, vec![0])]));
    let said = stderr(&import(folder.path(), &path, &images_only).0);
    assert!(said.contains("no messages on /camera/image_raw, which the map names; it has /other"), "{said}");
    let said = stderr(&import(folder.path(), &path, &images_only.replace("stamp:", "stamp_at:")).0);
    assert!(said.contains("topics.yaml:15:3: unknown key `stamp_at`"), "{said}");
    let said = stderr(&cellcal(&["import", text(&path), "-o", text(&folder.path().join("x.mcap"))]));
    assert!(
        said.contains("--map topics.yaml") && said.contains("/other (sensor_msgs/msg/Image, 1 messages)"),
        "{said}"
    );
}

/// Twenty seconds are missing, more than the 24 bits of EVT3 count: only the stamps can tell how many.
#[test]
fn missing_packets_do_not_shift_the_clock() {
    let folder = tempfile::tempdir().unwrap();
    let (mut encoder, mut sent) = (Encoder::new(Format::Evt3), Vec::new());
    let first_us = |number: u64| (SENSOR_AHEAD_S * 1e6) as i64 + number as i64 * 20_000;
    for number in 0..1300 {
        let event = |i: i64| Event { t_us: first_us(number) + i * 1000, x: 5, y: i as u16, on: true };
        let mut words = Vec::new();
        encoder.encode(&(0..20).map(event).collect::<Vec<_>>(), &[], &mut words).unwrap();
        if !(100..1100).contains(&number) {
            let at_s = 0.02 * number as f64 + 0.022;
            sent.push((at_s, "/event_camera/events", PACKET, packet(at_s, number, "evt3", &words)));
        }
    }
    let path = write(folder.path(), "bag.mcap", &bag(sent));
    let map = map().split("rgb:\n").next().unwrap().replace("mode: handeye ", "mode: stereo ")
        + "event: {topic: /event_camera/events, width: 1280, height: 720}\nstops: {intervals: [{id: all, from_s: 1, to_s: 2e9}]}\n";
    let (output, session) = import(folder.path(), &path, &map);
    assert!(json(&output)["notices"].to_string().contains("1000 packets of the event camera are missing"));
    let recording = Recording::from_bytes(&session, &std::fs::read(&session).unwrap()).unwrap();
    let packets: Vec<_> =
        recording.entries.iter().filter_map(|e| if let Entry::Events(p) = e { Some(p) } else { None }).collect();
    assert_eq!(packets.len(), 300);
    let gap = packets.windows(2).position(|p| p[1].sequence != p[0].sequence + 1).unwrap() + 1;
    assert_eq!(gap, 100);
    // The sensor of this stream is 31.25 s ahead modulo the 16.777216 s that it counts to.
    let ahead_us = first_us(0) - packets[0].time_base_ns as i64 / 1000;
    assert_eq!(ahead_us.rem_euclid(1 << 24), 0);
    for (packet, number) in packets.iter().zip((0..100).chain(1100..)) {
        // The first events after a gap wait for the next upper bits, up to 4 ms.
        let late_us = packet.time_base_ns as i64 / 1000 + ahead_us - first_us(number);
        assert!((0..=4096).contains(&late_us), "{number}: {late_us}");
    }
}

/// A real EVT3 stream with two trigger edges; counts published with the codec that it was recorded for.
#[test]
fn the_real_stream_has_its_published_counts() {
    let Some(of) = data("rosec_codecs_evt3_trigger") else { return };
    let folder = tempfile::tempdir().unwrap();
    let map = "mode: stereo\n\
        board: {dictionary: DICT_4X4_50, squares_x: 7, squares_y: 5, square_mm: 8.8, marker_mm: 7.04}\n\
        event: {topic: /event_camera/events, width: 1280, height: 720}\n\
        stops: {intervals: [{id: all, from_s: 1665782660, to_s: 1665782670}]}\n";
    let (output, session) = import(folder.path(), &of.join("test_data_evt3_trigger.ros2.mcap"), map);
    assert!(output.status.success(), "{}", stderr(&output));
    let recording = Recording::from_bytes(&session, &std::fs::read(&session).unwrap()).unwrap();
    let (mut decoder, mut events, mut triggers) = (Decoder::new(Format::Evt3), Vec::new(), Vec::new());
    let mut packets = 0;
    for entry in &recording.entries {
        if let Entry::Events(packet) = entry {
            decoder.decode(&packet.events, &mut events, &mut triggers);
            packets += 1;
        }
    }
    assert_eq!((packets, events.len()), (105, 82_469));
    assert_eq!(events.iter().map(|e| i128::from(e.t_us)).sum::<i128>(), 1_222_326_831_810);
    assert_eq!(events.iter().map(|e| u64::from(e.x)).sum::<u64>(), 42_078_718);
    assert_eq!(events.iter().map(|e| u64::from(e.y)).sum::<u64>(), 31_656_267);
    assert_eq!(events.iter().filter(|e| e.on).count(), 41_439);
    let edge = |t_us, rising| Trigger { t_us, channel: 0, rising };
    assert_eq!(triggers, [edge(14_547_491, false), edge(14_549_491, true)]);
    // There is no board in it: the replay must end well all the same.
    let result = json(&expect(3, &["replay", text(&session), "--json", "--set", "settings.method=paper"]));
    assert!(result["not_computed"]["cameras.event"].is_string(), "{result:#}");
}
