//! Corners without images, against an independent solve of the same corners.

use crate::support::{cellcal, data, expect, json, number, stderr, text};

#[test]
fn real_corners_give_the_stereo_pair_that_others_found() {
    let Some(folder) = data("calibration_rs_stereo_corners") else { return };
    let file = folder.join("stereo_linear.json");
    let temporary = tempfile::tempdir().unwrap();
    let session = temporary.path().join("corners.mcap");
    let refused = cellcal(&["import", text(&file), "-o", text(&session)]);
    let said = stderr(&refused);
    assert!(refused.status.code() == Some(1) && said.contains("--image-size 1024x576"), "{said}");
    let small = stderr(&cellcal(&["import", text(&file), "--image-size", "640x480", "-o", text(&session)]));
    assert!(small.contains("outside the image; --image-size is 640x480"), "{small}");
    expect(0, &["import", text(&file), "--image-size", "1024x576", "-o", text(&session)]);

    // One file and nothing else.
    let moved = temporary.path().join("elsewhere");
    std::fs::create_dir(&moved).unwrap();
    let session = std::fs::copy(&session, moved.join("s.mcap")).map(|_| moved.join("s.mcap")).unwrap();
    let first = expect(3, &["replay", text(&session), "--json", "--set", "settings.method=paper"]);
    let result = json(&first);
    for camera in ["rgb", "event"] {
        assert_eq!(number(&result, &format!("/cameras/{camera}/points")), 20.0 * 77.0);
        assert_eq!(number(&result, &format!("/cameras/{camera}/corner_rate")), 1.0);
    }
    assert_eq!(number(&result, "/stereo/pairs_used"), 20.0);
    // The notes of the data set, by OpenCV 4.14. They have four digits of the RMS, whose minimum is flat: 2e-4 px are
    // two of its last digits.
    let within = |pointer: &str, reference: f64, tolerance: f64| {
        let found = number(&result, pointer);
        eprintln!("{pointer}: {found}, the notes say {reference}");
        assert!(
            (found - reference).abs() <= tolerance,
            "{pointer} is {found}, the notes say {reference} +- {tolerance}"
        );
    };
    within("/cameras/rgb/rms_px", 0.2666, 2e-4);
    within("/cameras/event/rms_px", 0.2765, 2e-4);
    within("/stereo/rms_px", 0.2843, 2e-4);
    // Formal sigma of a focal length from 1540 corners of 0.2 px an axis is some 0.5 px of 714, and the baseline goes
    // with it: solvers that stop a fiftieth of that apart agree.
    within("/cameras/rgb/fx", 714.4, 0.06);
    within("/cameras/event/fx", 724.5, 0.06);
    within("/stereo/baseline_m", 0.189_499, 5e-6);
    within("/stereo/rotation_deg", 2.581, 1e-3);

    let usual = expect(3, &["replay", text(&session), "--json"]);
    let again = expect(3, &["replay", text(&session), "--json", "--from", "views"]);
    assert!(again.stdout == usual.stdout, "views give another result");
    // The folder is the same data set as its file.
    let of_folder = temporary.path().join("folder.mcap");
    expect(0, &["import", text(&folder), "--image-size", "1024x576", "--name", "corners", "-o", text(&of_folder)]);
    let of_folder = json(&expect(3, &["replay", text(&of_folder), "--json", "--set", "settings.method=paper"]));
    assert_eq!(of_folder["stereo"], result["stereo"]);
}
