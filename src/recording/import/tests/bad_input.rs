//! Wrong input is refused with file, line and column, and leaves nothing behind.

use super::*;

/// What the import of a changed folder says; checks that nothing was written.
fn error_after(change: impl FnOnce(&Fixture) -> &Fixture) -> String {
    let fixture = Fixture::new();
    change(&fixture);
    let error = fixture.import().unwrap_err().to_string();
    let out = fixture.output().parent().unwrap().to_owned();
    let left = fs::read_dir(out).map_or(0, |entries| entries.count());
    assert_eq!(left, 0, "something is left after: {error}");
    assert!(!error.ends_with('.') && !error.contains('\n'), "{error}");
    error
}

/// Each replacement in `file` gives an error that begins with the text.
fn refused(file: &str, cases: &[(&str, &str, &str)]) {
    for (from, to, expected) in cases {
        let error = error_after(|fixture| fixture.replace(file, from, to));
        assert!(error.starts_with(expected), "`{from}` -> `{to}`\n found {error}\n expected {expected}");
    }
}

#[test]
fn a_wrong_session_json_is_refused_at_line_and_column() {
    refused(
        "session.json",
        &[
            ("handeye", "other", "session.json:2:17: unknown variant `other`, expected `stereo` or `handeye`"),
            ("\"mode\": \"handeye\",", "", "session.json:13:1: missing field `mode`"),
            ("\"alpha\": 0.6", "\"mode\": \"stereo\"", "session.json:3:8: duplicate field `mode`"),
            ("0.6,", "1.6,", "session.json:3:3: alpha is 1.6, outside 0 to 1"),
            ("15.0", "NaN", "session.json:4:16: expected value"),
            ("15.0", "0", "session.json:4:3: toggle_hz is 0, outside 0.01 to 10000"),
            ("0.0070", "0.0088", "session.json:5:3: board cannot be: marker 0.0088 m does not fit"),
            (
                "0.0088",
                "8.8",
                "session.json:5:3: board cannot be: square 8.8 m is outside 0.001 to 1 m; is it in metres",
            ),
            (
                "DICT_4X4_50",
                "DICT_3X3",
                "session.json:5:3: board cannot be: dictionary `DICT_3X3` is unknown; allowed are DICT_4X4_50,",
            ),
            ("\"width\": 8,", "\"width\": 0,", "session.json:6:11: rgb.width is 0, outside 1 to 65535"),
            ("\"width\": 8,", "\"width\": -8,", "session.json:6:21: invalid value: integer `-8`, expected u32"),
            ("\"width\": 8, ", "", "session.json:6:22: missing field `width`"),
            ("720", "4000", "session.json:7:28: event.height is 4000, outside 1 to 2048"),
            (
                "0.0999",
                "99.9",
                "session.json:8:3: exposure_s is 99.9, longer than from one image to the next at 10 fps",
            ),
            ("  \"fps\": 10,\n", "", "session.json has no fps; an event camera needs it"),
            ("\"channel\": 0", "\"channel\": 300", "session.json:11:28: invalid value: integer `300`, expected u8"),
            (
                "exposure start",
                "exposure end?",
                "session.json:11:53: unknown variant `exposure end?`, expected `exposure start`",
            ),
            (
                "\"corner_id\": 9",
                "\"corner_id\": 24",
                "session.json:12:14: checks.corner_id is 24, the board has corners 0 to 23",
            ),
            ("0.0678", "67.8", "session.json:12:30: checks.d_target_tcp_m is 67.8, outside 0 to 10"),
            ("events.raw", "../events.raw", "session.json:7:43: event.raw is `../events.raw`, outside the folder"),
            ("events.raw", "e.raw", "session.json:7:43: event.raw is `e.raw`, but there is no such file"),
        ],
    );
    let error = error_after(|f| {
        f.replace("session.json", "\"rgb\"", "\"rgb_\"").replace("session.json", "\"event\"", "\"event_\"")
    });
    assert!(error.starts_with("session.json has no rgb and no event: at least one camera is needed"), "{error}");
    let error = error_after(|f| f.write("session.json", "[1, 2"));
    assert!(error.starts_with("session.json:1:"), "{error}");
}

#[test]
fn a_wrong_frames_csv_is_refused_at_line_and_column() {
    let (start_1, end_1) = (HOST_S + 1.0, HOST_S + 1.1);
    let columns = "frame_id,pose_id,index_in_pose,t_exp_start_host_s,t_exp_end_host_s,path\n";
    let row = format!("f0,a,0,{start_1},{end_1},images/0.png\n");
    let with = |id: &str, pose: &str, index: &str, start: &str, end: &str, path: &str| {
        format!("{id},{pose},{index},{start},{end},{path}\n")
    };
    let (start, end) = (start_1.to_string(), end_1.to_string());
    let image = "images/0.png";
    let cases = [
        (with("f0", "a", "0", "abc", &end, image), "t_exp_start_host_s is `abc`, not a number"),
        (with("f0", "a", "0", "", &end, image), "t_exp_start_host_s is empty"),
        (with("f0", "a", "0", &start, "NaN", image), "t_exp_end_host_s is `NaN`, not a finite number"),
        (with("f0", "a", "0", "-inf", &end, image), "t_exp_start_host_s is `-inf`, not a finite number"),
        (
            with("f0", "a", "0", "1.7e12", &end, image),
            "t_exp_start_host_s is `1.7e12`, outside -10000000000 to 10000000000; is it in seconds?",
        ),
        (with("f0", "a", "0", &end, &start, image), "t_exp_end_host_s is 1700000124, not after t_exp_start_host_s"),
        (with("f1", "a", "0", &start, &end, image), "frame_id `f1` is there already"),
        (with("", "a", "0", &start, &end, image), "frame_id is empty"),
        (with("f0", "q", "0", &start, &end, image), "pose_id is `q`, which is no pose_id in poses.csv"),
        (with("f0", "a", "x", &start, &end, image), "index_in_pose is `x`, not a whole number from 0 on"),
        (with("f0", "a", "0", &start, &end, "images/9.png"), "path is `images/9.png`, but there is no such file"),
        (with("f0", "a", "0", &start, &end, "/etc/passwd"), "path is `/etc/passwd`, outside the folder"),
        (with("f0", "a", "0", &start, &end, "images/1.jpg"), "path is `images/1.jpg`, the image of an earlier row"),
        (format!("f0,a,0,{start_1}\n"), "4 cells, the header has 6; there is none for t_exp_end_host_s"),
        (format!("f0,a,0,{start_1},{end_1},{image},1\n"), "7 cells, the header has 6; is there a comma too many?"),
        (",,,,,\n".into(), "frame_id is empty"),
        (String::new(), "index_in_pose is 1, expected 0 for pose `a`; a row is missing"),
        (
            with("f0", "a", "0", &(HOST_S + 1.2).to_string(), &(HOST_S + 1.3).to_string(), image),
            "t_exp_start_host_s is 1700000124.125, not after 1700000124.2 in frames.csv:2",
        ),
    ];
    for (replacement, expected) in &cases {
        let error = error_after(|fixture| fixture.replace("frames.csv", &row, replacement));
        // Duplicates and order show at the later row.
        let lines = ["frames.csv:2: ", "frames.csv:3: "];
        assert!(lines.iter().any(|line| error.starts_with(&format!("{line}{expected}"))), "{error}\n{expected}");
    }
    for (change, expected) in [
        (columns.replace("path", "paths"), "frames.csv:1: column path is missing; the columns are frame_id, pose_id,"),
        (columns.replace("path", "pose_id"), "frames.csv:1: column pose_id is there twice"),
    ] {
        let error = error_after(|fixture| fixture.replace("frames.csv", columns, &change));
        assert!(error.starts_with(expected), "{error}");
    }
}

#[test]
fn a_table_that_is_empty_or_no_text_is_refused() {
    let whole = |name: &'static str, bytes: &'static [u8]| error_after(move |f| f.write_bytes(name, bytes));
    assert!(whole("frames.csv", b"").starts_with("frames.csv is empty; the first line must name the columns frame_id"));
    let header = b"frame_id,pose_id,index_in_pose,t_exp_start_host_s,t_exp_end_host_s,path\n";
    assert!(whole("frames.csv", header).starts_with("frames.csv has no rows"));
    assert!(whole("poses.csv", b"a,b\nc,\xff\n").starts_with("poses.csv:2: not UTF-8 text"));
    let error = error_after(|f| f.remove("frames.csv"));
    assert_eq!(error, "frames.csv is missing");
}

#[test]
fn wrong_poses_are_refused_at_line_and_column() {
    let still_a = format!("{},{}", HOST_S + 0.75, HOST_S + 1.25);
    let swapped = format!("{},{}", HOST_S + 1.25, HOST_S + 0.75);
    refused(
        "poses.csv",
        &[
            ("c,distance,P", "b,distance,P", "poses.csv:4: pose_id `b` is there already, in poses.csv:3"),
            ("0.1,-0.4,0.3,", "100,-400,300,", "poses.csv:2: x is `100`, outside -10 to 10; is it in millimetres"),
            ("0.1,-0.4,0.3,", "0.1,nan,0.3,", "poses.csv:2: y is `nan`, not a finite number"),
            ("0.1,-0.4,0.3,", "0.1,,0.3,", "poses.csv:2: y is empty"),
            ("3.1,0.2,-0.1", "177,11,-6", "poses.csv:2: rx is `177`, outside -7 to 7; is it in degrees"),
            ("0.1,-1.2,1.3,", "6,-70,75,", "poses.csv:2: q1 is `-70`, outside -7 to 7; is it in degrees"),
            (",,,,,,\n", ",,,1,,,\n", "poses.csv:4: q0 is empty"),
            (
                "0.1,-0.4,0.3,3.1,0.2,-0.1",
                "0,0,0,0,0,0",
                "poses.csv:2: x, y, z, rx, ry, rz are empty or all zero, but its kind",
            ),
            (&still_a, &swapped, "poses.csv:2: t_still_to_host_s is 1700000123.75, not after t_still_from_host_s"),
            ("handeye", "", "poses.csv:2: kind is empty"),
            ("handeye", "hand-eye", "poses.csv has no pose of kind `handeye`, but session.json says mode handeye"),
            ("q4,", "q_4,", "poses.csv:1: column q4 is missing, but q0, q1, q2, q3, q5 is there"),
            ("c,distance,P", "c,distance,Q", "poses.csv:4: pair is `Q`, which pairs.csv does not have"),
            ("a,handeye,", "a,handeye,P", "poses.csv:2: pair is `P`, which pairs.csv says is `b` and `c`"),
        ],
    );
    refused(
        "pairs.csv",
        &[
            ("P,b,c", "P,b,x", "pairs.csv:2: pose_b is `x`, which is no pose_id in poses.csv"),
            ("P,b,c", "P,b,b", "pairs.csv:2: pose_a and pose_b are both `b`"),
            ("0.05", "50", "pairs.csv:2: d_gt_m is `50`, outside -10 to 10; is it in millimetres"),
            ("0.05", "0", "pairs.csv:2: d_gt_m is 0, a distance is above 0"),
            ("0.05", "0.05\nP,b,c,1", "pairs.csv:3: pair `P` is there already"),
        ],
    );
}

#[test]
fn exposures_that_never_meet_a_still_interval_are_refused() {
    let error = error_after(|fixture| {
        for at_s in [0.75, 2.75, 4.75] {
            let (from, to) = (HOST_S + at_s, HOST_S + at_s + 0.5);
            fixture.replace("poses.csv", &format!("{from},{to}"), &format!("{at_s},{}", at_s + 0.5));
        }
        fixture
    });
    assert!(error.starts_with("frames.csv has no exposure inside the still interval of its pose"), "{error}");
}

#[test]
fn images_that_are_unreadable_or_of_another_size_are_named() {
    let with = |name: &'static str, bytes: Vec<u8>| error_after(move |f| f.write_bytes(name, &bytes));
    let error = with("images/3.png", png(9, 6));
    assert_eq!(
        error,
        "images/3.png is 9 x 6 pixels, but session.json says 8 x 6 (named in frames.csv:5); all images of a camera must have one size"
    );
    let cut = png(8, 6)[..40].to_vec();
    assert_eq!(
        with("images/3.png", cut),
        "images/3.png is unreadable: the png is cut off after 40 bytes (named in frames.csv:5)"
    );
    assert!(with("images/4.png", Vec::new()).starts_with("images/4.png is unreadable: the file is empty"));
    assert!(with("images/4.png", b"hello".to_vec()).contains("it begins with `hello`, which is neither PNG nor JPEG"));
    let error = error_after(|f| f.replace("session.json", "  \"rgb\": {\"width\": 8, \"height\": 6},\n", ""));
    assert!(
        error.starts_with("frames.csv:2: path is `images/0.png`, but session.json declares no rgb camera"),
        "{error}"
    );
}

#[test]
fn the_reason_of_the_decoder_is_passed_on() {
    let fixture = Fixture::new();
    let options = ImportOptions::default();
    let failing = |_: &[u8]| Err("bad checksum".to_owned());
    let error = import(&fixture.folder(), &fixture.output(), &options, &failing, &mut |_, _| ()).unwrap_err();
    assert_eq!(error.to_string(), "images/0.png is unreadable: bad checksum (named in frames.csv:2)");
}

#[test]
fn a_wrong_raw_file_is_refused() {
    let with = |bytes: Vec<u8>| error_after(move |f| f.write_bytes("events.raw", &bytes));
    assert!(with(Vec::new()).starts_with("events.raw cannot be read: the file is empty"));
    assert!(with(b"\x89HDF".to_vec()).starts_with("events.raw cannot be read: not a Prophesee RAW file"));
    let error = error_after(|f| f.replace("session.json", "1280", "640"));
    assert!(
        error.starts_with("events.raw is of a 1280x720 sensor by its header, but session.json says 640x720"),
        "{error}"
    );
    let error = error_after(|f| f.replace("session.json", "\"channel\": 0", "\"channel\": 6"));
    assert!(error.starts_with("events.raw has no rising edge on trigger channel 6 (found 8 on channel 0)"), "{error}");
    let header = with(Header::new(Format::Evt3, 1280, 720).to_bytes());
    assert!(header.starts_with("events.raw has no rising edge on trigger channel 0 (found none at all)"), "{header}");
    let error = error_after(|f| f.remove("events.raw"));
    assert!(error.starts_with("session.json:7:43: event.raw is `events.raw`, but there is no such file"), "{error}");
}

#[test]
fn a_folder_that_fits_no_layout_is_described() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path();
    let error = |folder: &Path| {
        import_folder(folder, &path.join("out.mcap"), &ImportOptions::default()).unwrap_err().to_string()
    };
    let empty = path.join("empty");
    fs::create_dir(&empty).unwrap();
    assert!(error(&empty).ends_with("found nothing: it is empty"), "{}", error(&empty));
    assert!(error(&path.join("nowhere")).starts_with("cannot read the folder"));
    fs::write(path.join("file"), "x").unwrap();
    assert!(error(&path.join("file")).ends_with("give the folder that holds the data set"));
    for i in 10..22 {
        fs::write(empty.join(format!("{i}.txt")), "x").unwrap();
    }
    let text = error(&empty);
    assert!(text.contains("looked for session.json (layout A: session folder), cal_data.yaml (layout B"), "{text}");
    assert!(
        text.ends_with(
            "found 10.txt, 11.txt, 12.txt, 13.txt, 14.txt, 15.txt, 16.txt, 17.txt, 18.txt, 19.txt and 2 more"
        ),
        "{text}"
    );
    fs::write(empty.join("session.json"), "{}").unwrap();
    fs::write(empty.join("cal_data.yaml"), "").unwrap();
    assert!(error(&empty).contains("holds both session.json (layout A) and cal_data.yaml (layout B)"));
}

#[test]
fn an_existing_output_is_not_touched() {
    let fixture = Fixture::new();
    fs::create_dir_all(fixture.output().parent().unwrap()).unwrap();
    fs::write(fixture.output(), "precious").unwrap();
    let error = fixture.import().unwrap_err().to_string();
    assert!(error.ends_with("exists already; choose another name"), "{error}");
    assert_eq!(fs::read(fixture.output()).unwrap(), b"precious");
}

#[test]
fn files_cut_anywhere_are_refused_or_noted_and_never_panic() {
    let fixture = Fixture::new();
    for (name, step) in
        [("session.json", 7), ("frames.csv", 5), ("poses.csv", 5), ("pairs.csv", 1), ("events.raw", 501)]
    {
        let whole = fs::read(fixture.folder().join(name)).unwrap();
        for cut in (0..whole.len()).step_by(step) {
            fixture.write_bytes(name, &whole[..cut]);
            match fixture.import() {
                // The last digits of a table and the events after a cut cannot be missed; the cut in the events is seen.
                Ok(report) => {
                    fs::remove_file(report.path).unwrap();
                    let noted = report
                        .notices
                        .iter()
                        .any(|n| n.contains("missing, doubled or extra") || n.contains("into a word"));
                    assert!(name != "events.raw" || noted || cut + 2000 > whole.len(), "{cut}: {:?}", report.notices);
                }
                Err(_) => assert!(!fixture.output().with_extension("mcap.partial").exists()),
            }
        }
        fixture.write_bytes(name, &whole);
    }
}
