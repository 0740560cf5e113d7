//! Layout A: what is in the folder is in the session.

use super::*;
use crate::calibration::settings::PoseKind;
use crate::events::Decoder;
use crate::geometry::{Camera, Transform};
use crate::recording::Kind;

#[test]
fn everything_in_the_folder_is_in_the_session() {
    let fixture = Fixture::new();
    let (report, recording) = fixture.imported();
    assert_eq!((report.poses, report.images, report.path.clone()), (3, 4, fixture.output()));
    assert_eq!(
        report.notices,
        ["poses with more or fewer exposures than windows_per_pose (2): b", "poses without an image: b"]
    );
    assert!(recording.damage.is_empty());
    assert_eq!((recording.about.kind, recording.about.session_id.as_str()), (Kind::Imported, "s1"));
    assert_eq!(recording.about.facts["host_origin_s"], "1700000123");
    let names: Vec<_> = recording.about.facts.keys().cloned().collect();
    let hashed = ["events.raw", "frames.csv", "pairs.csv", "poses.csv", "session.json"].map(|n| format!("sha256:{n}"));
    assert_eq!(names, [&["host_origin_s".to_owned()], hashed.as_slice()].concat());
    // sha256sum of the text, by another tool.
    assert_eq!(
        recording.about.facts["sha256:pairs.csv"],
        "1bd73e2f0db5b2233176e649de54f3ff2fe72b85dcc1387aa87a35020d5da2c4"
    );

    let images: Vec<&Vec<u8>> = recording
        .entries
        .iter()
        .filter_map(|e| if let Entry::Image(_, image) = e { Some(image) } else { None })
        .collect();
    assert_eq!(images, [&png(8, 6), &jpeg(8, 6), &png(8, 6), &png(8, 6)]);
    let captures = captures(&recording);
    assert_eq!(captures.iter().map(|(_, c)| c.pose).collect::<Vec<_>>(), [0, 1, 2]);
    let exposures: Vec<_> = captures.iter().flat_map(|(_, c)| &c.exposures).map(|e| (e.start_s, e.image)).collect();
    assert_eq!(exposures, [(1.0, true), (1.125, true), (3.0, false), (5.0, true), (5.125, true)]);
    assert!((captures[0].0 - 1.225).abs() < 1e-6, "{}", captures[0].0);
    assert_eq!(captures[0].1.event_bytes, report.event_bytes);

    let declared = captures[0].1.declared.as_ref().unwrap();
    assert_eq!(declared.still_s, Some([0.75, 1.25]));
    assert_eq!(declared.base_from_tcp, Some(Transform::from_pose_vector([0.1, -0.4, 0.3, 3.1, 0.2, -0.1])));
    assert_eq!(declared.joints_rad, Some([0.1, -1.2, 1.3, -1.5, -1.6, 0.2]));
    assert!(captures[1..].iter().all(|(_, c)| c.declared.as_ref().unwrap().joints_rad.is_none()));
}

#[test]
fn the_setup_is_what_the_files_say() {
    let fixture = Fixture::new();
    let setup = fixture.imported().1.import_setup().unwrap();
    assert_eq!((setup.name.as_str(), setup.robot_poses), ("paper set", true));
    assert_eq!((setup.board.squares_x, setup.board.dictionary.as_str()), (7, "DICT_4X4_50"));
    let size = |camera| (setup.cameras[&camera].width, setup.cameras[&camera].height);
    assert_eq!((size(Camera::Rgb), size(Camera::Event)), ((8, 6), (1280, 720)));
    assert_eq!((setup.exposure_s, setup.image_period_s, setup.trigger_channel), (Some(0.0999), Some(0.1), Some(0)));
    let kinds: Vec<_> = setup.poses.iter().map(|p| (p.id.as_str(), p.kind)).collect();
    assert_eq!(kinds, [("a", PoseKind::HandEye), ("b", PoseKind::Distance), ("c", PoseKind::Distance)]);
    assert_eq!((setup.pairs.len(), setup.pairs[0].truth_m), (1, 0.05));
    assert_eq!(setup.checks.unwrap().target_to_tcp_m, Some(0.0678));
}

#[test]
fn event_bytes_come_back_in_every_format_and_each_packet_knows_its_time() {
    let formats = [
        (Format::Evt2, "evt2"),
        (Format::Evt3, "evt3"),
        (Format::Evt21 { legacy_halves: false }, "evt21"),
        (Format::Evt21 { legacy_halves: true }, "evt21_legacy"),
    ];
    for (format, encoding) in formats {
        let fixture = Fixture::new();
        let (bytes, triggers) = raw(format, 60_000);
        fixture.write_bytes("events.raw", &bytes);
        let (report, recording) = fixture.imported();
        let header = recording.text("events.header").unwrap();
        let packets = packets(&recording);
        assert_eq!(
            [header.as_bytes(), &packets.iter().flat_map(|p| p.events.clone()).collect::<Vec<_>>()].concat(),
            bytes
        );
        assert_eq!(report.event_bytes, (bytes.len() - header.len()) as u64);
        assert!(packets.len() > 2 && packets.iter().all(|p| p.encoding == encoding && p.width == 1280));
        assert!(packets.iter().map(|p| p.sequence).eq(0..packets.len() as u64));

        let (mut whole, mut found) = (Decoder::new(format), Vec::new());
        for packet in &packets {
            // A decoder that joins here, told the time of the packet, agrees with one that saw everything.
            let (mut events, mut joined) = (Vec::new(), Vec::new());
            whole.decode(&packet.events, &mut events, &mut found);
            let first_us = events[0].t_us;
            assert!(packet.time_base_ns.abs_diff(first_us as u64 * 1000) < 1_000_000, "{encoding}");
            let mut late = Decoder::new(format);
            late.set_epoch_us((packet.time_base_ns / 1000) as i64);
            late.decode(&packet.events, &mut joined, &mut Vec::new());
            assert_eq!(joined.last(), events.last(), "{encoding}");
        }
        // The encoder's first wrap is the decoder's: relative times are what counts.
        let shift_us = triggers[0].t_us - found[0].t_us;
        assert!(found.iter().zip(&triggers).all(|(f, t)| f.t_us + shift_us == t.t_us) && found.len() == 16);
    }
}

#[test]
fn importing_twice_gives_equal_bytes_and_no_path_of_this_computer() {
    let (one, other) = (Fixture::new(), Fixture::new());
    let bytes = [&one, &other].map(|fixture| fs::read(fixture.import().unwrap().path).unwrap());
    assert_eq!(bytes[0], bytes[1]);
    let path = one.dir.path().to_str().unwrap();
    assert!(!bytes[0].windows(path.len()).any(|window| window == path.as_bytes()));
}

#[test]
fn a_stereo_session_keeps_robot_poses_but_does_not_use_them() {
    let fixture = Fixture::new();
    fixture.replace("session.json", "handeye", "stereo").replace("poses.csv", "distance", "whatever it was");
    let (_, recording) = fixture.imported();
    let setup = recording.import_setup().unwrap();
    assert!(!setup.robot_poses && setup.poses.iter().all(|p| p.kind == PoseKind::Intrinsics));
    assert!(captures(&recording).iter().all(|(_, c)| c.declared.as_ref().unwrap().base_from_tcp.is_some()));
}

#[test]
fn handheld_cameras_need_no_robot_poses() {
    let fixture = Fixture::new();
    fixture.replace("session.json", "handeye", "stereo").remove("pairs.csv");
    let still = |at_s: f64| format!("{},{}", HOST_S + at_s, HOST_S + at_s + 0.5);
    let header = "pose_id,kind,pair,t_still_from_host_s,t_still_to_host_s";
    fixture.write("poses.csv", &format!("{header}\na,,,{}\nb,,,{}\nc,,,{}\n", still(0.75), still(2.75), still(4.75)));
    let (_, recording) = fixture.imported();
    assert!(captures(&recording).iter().all(|(_, c)| c.declared.as_ref().unwrap().base_from_tcp.is_none()));
    fixture.replace("session.json", "stereo", "handeye");
    fs::remove_file(fixture.output()).unwrap();
    let error = fixture.import().unwrap_err().to_string();
    assert!(error.starts_with("poses.csv:1: column x, y, z, rx, ry, rz is missing"), "{error}");
}

#[test]
fn either_camera_alone_is_enough() {
    let fixture = Fixture::new();
    fixture.replace("session.json", "  \"event\": {\"width\": 1280, \"height\": 720, \"raw\": \"events.raw\"},\n", "");
    fixture.replace("session.json", "  \"alpha\": 0.6,\n", "");
    let (report, recording) = fixture.imported();
    assert_eq!((report.event_bytes, packets(&recording).len(), report.images), (0, 0, 4));

    let fixture = Fixture::new();
    fixture.replace("session.json", "  \"rgb\": {\"width\": 8, \"height\": 6},\n", "");
    for image in ["images/0.png", "images/1.jpg", "images/3.png", "images/4.png"] {
        fixture.replace("frames.csv", image, "");
    }
    let (report, recording) = fixture.imported();
    assert_eq!((report.images, recording.import_setup().unwrap().cameras.len()), (0, 1));
    assert!(report.event_bytes > 0);
}

#[test]
fn unknown_keys_and_columns_are_ignored_with_one_notice_each() {
    let fixture = Fixture::new();
    fixture.replace("session.json", "\"fps\"", "\"operator\": \"me\", \"fps\"");
    fixture.replace("session.json", "\"channel\"", "\"colour\": 3, \"channel\"");
    for file in ["frames.csv", "poses.csv"] {
        let text = fs::read_to_string(fixture.folder().join(file)).unwrap();
        let lines = text.lines().enumerate().map(|(i, line)| format!("{line},{}", if i == 0 { "gain" } else { "7" }));
        fixture.write(file, &lines.collect::<Vec<_>>().join("\r\n"));
    }
    let (report, recording) = fixture.imported();
    assert_eq!(report.notices[0], "ignored unknown keys: session.json: operator, session.json: trigger.colour");
    assert_eq!(report.notices[1], "ignored unknown columns: poses.csv: gain, frames.csv: gain");
    assert_eq!((report.notices.len(), captures(&recording).len()), (4, 3));
}

#[test]
fn odd_but_usable_input_is_noted() {
    let fixture = Fixture::new();
    let (mut bytes, _) = raw(Format::Evt3, 2000);
    bytes.push(0x12);
    fixture.write_bytes("events.raw", &bytes);
    fixture.remove("pairs.csv").replace("poses.csv", "c,distance", "c2,distance").replace(
        "poses.csv",
        "a,handeye",
        "z,handeye",
    );
    let text = fs::read_to_string(fixture.folder().join("frames.csv")).unwrap();
    let kept: Vec<String> = text.lines().filter(|l| !l.contains(",a,")).map(|l| l.replace(",c,", ",c2,")).collect();
    fixture.write("frames.csv", &kept.join("\n"));
    let (report, recording) = fixture.imported();
    let text = report.notices.join("\n");
    for part in [
        "2 poses name a pair, but pairs.csv is missing",
        "pose z has no frames",
        "events.raw ends 1 bytes into a word",
        "events.raw has 8 rising edges on channel 0, 3 exposures and 2 closing pulses would give 5",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    let header = recording.text("events.header").unwrap().len();
    assert_eq!(packets(&recording).iter().flat_map(|p| p.events.clone()).collect::<Vec<_>>(), bytes[header..]);
    assert_eq!(captures(&recording).iter().map(|(_, c)| c.pose).collect::<Vec<_>>(), [1, 2]);
}
