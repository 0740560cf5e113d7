//! Real recordings against the numbers that others published for them.

use nalgebra::Vector3;

use crate::support::{cellcal, data, expect, json, number, rotation, text, vector};

/// A real ABB arm, a static camera, 16 images; reference numbers from the notes of the data set, computed
/// with OpenCV 4.14 from its own intrinsics.
#[test]
fn the_real_arm_is_calibrated_as_by_others() {
    let Some(folder) = data("rct_charuco_static_camera") else { return };
    let temporary = tempfile::tempdir().unwrap();
    let session = temporary.path().join("abb.mcap");
    expect(0, &["import", text(&folder), "-o", text(&session)]);
    // No gates: inconclusive.
    let first = expect(3, &["replay", text(&session), "--json", "--set", "settings.method=paper"]);
    let result = json(&first);

    let within = |pointer: &str, reference: f64, tolerance: f64| {
        let found = number(&result, pointer);
        assert!(
            (found - reference).abs() <= tolerance,
            "{pointer} is {found}, the notes say {reference} +- {tolerance}"
        );
    };
    within("/cameras/rgb/fx", 1359.66, 0.005 * 1359.66);
    within("/cameras/rgb/fy", 1360.35, 0.005 * 1360.35);
    within("/cameras/rgb/cx", 774.35, 8.0);
    within("/cameras/rgb/cy", 624.40, 8.0);

    let reference =
        [("tsai", Vector3::new(-0.01863, 1.26386, 0.29004)), ("park", Vector3::new(-0.01836, 1.26374, 0.28997))];
    for (solver, known) in reference {
        let found = vector(&result, &format!("/hand_eye/panel/{solver}/translation_m"));
        let off_m = (found - known).norm();
        assert!(off_m < 0.002, "{solver}: {found:?} is {off_m} m from the notes");
    }
    // The two solvers of `A X = Z B`: how the target scatters through their cameras, by the same notes 1.85 and 4.19 mm
    // where Tsai's has 1.93 mm. Their images and corners are not quite ours, whose scatter is smaller, so ratios compare.
    let tsai_m = number(&result, "/hand_eye/scatter_rms_m");
    for (solver, known, tolerance) in [("shah", 1.85 / 1.93, 0.1), ("li", 4.19 / 1.93, 0.5)] {
        let chosen = format!("settings.hand_eye={solver}");
        let other =
            json(&expect(3, &["replay", text(&session), "--json", "--set", "settings.method=paper", "--set", &chosen]));
        let found = number(&other, "/hand_eye/scatter_rms_m") / tsai_m;
        assert!(
            (found - known).abs() <= tolerance,
            "{solver}: {found} times the scatter of tsai, in the notes {known}"
        );
        assert_eq!(other["hand_eye"]["method"], solver);
    }
    // Li's answer is in the panel, and does not widen its spread.
    let place = |solver: &str| vector(&result, &format!("/hand_eye/panel/{solver}/translation_m"));
    let spread_m = number(&result, "/hand_eye/panel_spread_m");
    assert!((place("li") - place("tsai")).norm() > spread_m, "{spread_m}");
    assert!((place("shah") - place("tsai")).norm() <= spread_m, "{spread_m}");

    // The published camera of the same images; its intrinsics are other ones, so only the rotation compares.
    let known = [-0.0480798, -0.558686, 0.827604, -0.0251035];
    let known =
        nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(known[3], known[0], known[1], known[2]));
    let found = rotation(&result, "/hand_eye/panel/park/quaternion_xyzw");
    assert!(found.angle_to(&known).to_degrees() < 1.5, "{:?}", found.angle_to(&known).to_degrees());

    // The unusable image (2) and the outlying one (15) are named.
    for (pose, why) in [(2, "corners found"), (15, "corners found")] {
        let reason = result["poses"][pose]["reason"].as_str().unwrap();
        assert!(reason.contains(why) && result["poses"][pose]["used"] == false, "pose {pose}: {reason}");
    }

    // The same bytes on any number of threads, and from the stored views.
    for threads in ["1", "2", "8"] {
        let again =
            expect(3, &["replay", text(&session), "--json", "--set", "settings.method=paper", "--threads", threads]);
        assert!(again.stdout == first.stdout, "{threads} threads give another result");
    }
    // The usual method, too.
    let usual = expect(3, &["replay", text(&session), "--json", "--threads", "1"]);
    let again = expect(3, &["replay", text(&session), "--json", "--threads", "2"]);
    let views = expect(3, &["replay", text(&session), "--json", "--from", "views"]);
    assert!(again.stdout == usual.stdout, "two threads give another result");
    assert!(views.stdout == usual.stdout, "views give another result");
}

#[test]
fn with_foreign_intrinsics_the_outlier_stands_out() {
    let Some(folder) = data("rct_charuco_static_camera") else { return };
    let temporary = tempfile::tempdir().unwrap();
    let session = temporary.path().join("abb.mcap");
    expect(0, &["import", text(&folder), "-o", text(&session)]);
    let solved = json(&expect(3, &["replay", text(&session), "--json", "--set", "settings.method=paper"]));
    let result = temporary.path().join("result.json");
    // The published camera, without distortion.
    let mut known = solved;
    for (key, value) in [("fx", 1352.02747), ("fy", 1356.14287), ("cx", 789.67065), ("cy", 627.2995)] {
        known["cameras"]["rgb"][key] = value.into();
    }
    known["cameras"]["rgb"]["distortion"] = serde_json::json!([0.0, 0.0, 0.0, 0.0, 0.0]);
    std::fs::write(&result, known.to_string()).unwrap();
    let what_if = [
        "--intrinsics",
        text(&result),
        "--set",
        "settings.method=paper",
        "--set",
        "settings.reject_view_above_px=50",
        "--set",
        "settings.min_corners=5",
    ];
    let output = expect(3, &[&["replay", text(&session), "--json"][..], &what_if].concat());
    let with_foreign = json(&output);
    assert!(with_foreign["overrides"].as_array().unwrap().len() == 4, "{with_foreign:#}");
    let reason = with_foreign["poses"][15]["reason"].as_str().unwrap_or_default();
    assert!(reason.contains("outlier"), "image 15 is not named: {reason}");
}

#[test]
fn real_event_files_decode_to_the_published_counts() {
    for (folder, file) in [("faery_evt2", "evt2.raw"), ("rosec_codecs_evt3_trigger", "stream_as_evt3.raw")] {
        let Some(folder) = data(folder) else { return };
        let info = json(&expect(0, &["events", "info", text(&folder.join(file)), "--json"]));
        let notes: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(folder.join("expected.json")).unwrap()).unwrap();
        let expected = &notes["expected"];
        for (ours, theirs) in
            [("events", "n"), ("on", "n_on"), ("off", "n_off"), ("first_us", "t_first"), ("last_us", "t_last")]
        {
            assert_eq!(info[ours], expected[theirs], "{file}: {ours}");
        }
        assert_eq!(info["sha256"], expected["sha256_packed_t_i64_x_u16_y_u16_p_u8"], "{file}");
    }
}

#[test]
fn damaged_recordings_are_read_as_far_as_they_go() {
    let Some(folder) = data("mcap_recovery") else { return };
    let notes: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("expected.json")).unwrap()).unwrap();
    let mut seen = 0;
    for (file, expected) in notes.as_object().unwrap() {
        let Ok(bytes) = std::fs::read(folder.join(file)) else { continue };
        let scan = cellcal::recording::scan::scan(&bytes);
        let key = if expected.get("messages_in_good_chunks").is_some() {
            "messages_in_good_chunks"
        } else {
            "messages_in_complete_records"
        };
        let floor = expected[key].as_u64().unwrap() as usize;
        assert!(scan.messages.len() >= floor, "{file}: {} of {floor} messages", scan.messages.len());
        let whole = expected.get("data_end_seen").is_some_and(|v| v == true);
        assert_eq!(scan.damage.is_empty(), whole, "{file}: {:?}", scan.damage);
        seen += 1;
    }
    assert!(seen >= 10, "only {seen} damaged files were found");
}

#[test]
fn a_recording_of_another_tool_is_named() {
    let Some(folder) = data("mcap_crate_testdata") else { return };
    let output = cellcal(&["replay", text(&folder.join("compressed.mcap"))]);
    let said = crate::support::stderr(&output);
    assert!(output.status.code() == Some(1) && said.contains("not a cellcal session"), "{said}");
}
