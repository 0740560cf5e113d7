//! The reports as a reader sees them.

use super::fixture::{carried_cameras, nothing, session};
use super::{html, terminal};
use crate::calibration::result::CalibrationResult;
use crate::geometry::Transform;

/// Set `CELLCAL_UPDATE_EXPECTED` to write the file, and review the difference.
#[test]
fn the_terminal_text_is_as_expected() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/expected/report.txt");
    let text = terminal(&session());
    if std::env::var_os("CELLCAL_UPDATE_EXPECTED").is_some() {
        std::fs::write(path, &text).unwrap();
    }
    let expected = std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{path}: {e}"));
    for (i, (found, wanted)) in text.lines().zip(expected.lines()).enumerate() {
        assert_eq!(found, wanted, "line {} of {path}", i + 1);
    }
    assert_eq!(text.lines().count(), expected.lines().count());
}

#[test]
fn lines_fit_and_hold_no_control_codes() {
    for result in [session(), carried_cameras(), nothing(), hostile()] {
        let text = terminal(&result);
        let long: Vec<_> = text.lines().filter(|l| l.chars().count() > 100).collect();
        assert!(long.is_empty(), "{long:#?}");
        assert!(text.chars().all(|c| c == '\n' || !c.is_control()));
    }
}

/// Text from users in every place that takes some.
fn hostile() -> CalibrationResult {
    let attack = "<script>alert(1)</script>\"'><img src=x onerror=y>&\u{1b}[31m\u{202e}";
    let mut result = session();
    let text = || attack.to_owned();
    (result.cell, result.session_id, result.program_version) = (text(), text(), text());
    result.verdict.reasons.push(text());
    result.overrides.push(text());
    result.warnings.push(text());
    result.not_computed.insert(text(), text());
    for pose in &mut result.poses {
        pose.pose_id.push_str(attack);
        pose.reason = Some(text());
    }
    for camera in result.cameras.values_mut() {
        (camera.serial, camera.lens) = (Some(text()), Some(text()));
    }
    let hand_eye = result.hand_eye.as_mut().unwrap();
    hand_eye.panel_failed.values_mut().for_each(|v| *v = text());
    let uncertainty = hand_eye.uncertainty.as_mut().unwrap();
    (uncertainty.culprit.pose_id, uncertainty.most_influential.pose_id) = (text(), text());
    hand_eye.observability.axes_frame = text();
    result.checks.target_to_tcp.as_mut().unwrap().per_pose.iter_mut().for_each(|p| p.pose_id.push_str(attack));
    for pair in &mut result.checks.base_distance.as_mut().unwrap().per_pair {
        (pair.pair, pair.pose_a, pair.pose_b) = (text(), text(), text());
    }
    result.timing.as_mut().unwrap().notes.push(text());
    let provenance = &mut result.provenance;
    (provenance.opencv, provenance.board_layout, provenance.board_frame) = (text(), text(), text());
    (provenance.intrinsics, provenance.board.dictionary) = (text(), text());
    provenance.facts.insert(text(), text());
    provenance.sha256.insert(text(), text());
    result
}

#[test]
fn text_of_users_stays_text_in_the_page() {
    let page = html(&hostile());
    assert_eq!(page.matches("<script").count() + page.matches("<img").count(), 0);
    assert!(page.matches("&lt;script&gt;").count() > 100, "the text itself is shown");
    let unsafe_chars = ['\u{1b}', '\u{202e}'];
    assert!(!page.contains(unsafe_chars));
    // Tags are the same as without the attack, so that no text has opened, closed or entered one.
    let mut harmless = hostile_as_words();
    let tags = |page: &str| page.matches('<').count();
    assert_eq!(tags(&page), tags(&html(&harmless)));
    harmless.warnings.push("one more".into());
    assert_eq!(tags(&page) + 2, tags(&html(&harmless)), "the comparison can fail");
}

fn hostile_as_words() -> CalibrationResult {
    let text = serde_json::to_string(&hostile()).unwrap();
    let attack =
        serde_json::to_string("<script>alert(1)</script>\"'><img src=x onerror=y>&\u{1b}[31m\u{202e}").unwrap();
    serde_json::from_str(&text.replace(attack.trim_matches('"'), "words")).unwrap()
}

#[test]
fn the_page_stands_alone() {
    for result in [session(), carried_cameras(), nothing()] {
        let page = html(&result);
        assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>\n"));
        for loaded in ["src=", "url(", "@import", "<link", "<script", "<iframe", "https:"] {
            assert!(!page.contains(loaded), "{loaded}");
        }
        let addresses = page.matches("http:").count();
        assert_eq!(addresses, page.matches("xmlns=\"http://www.w3.org/2000/svg\"").count());
        assert!(!page.contains("NaN") && !page.contains("inf\""));
        for tag in ["section", "div", "table", "tr", "svg", "figure", "dl", "ul", "p"] {
            let opened = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
            assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}

#[test]
fn the_same_result_gives_the_same_bytes() {
    assert_eq!(terminal(&session()), terminal(&session()));
    assert_eq!(html(&session()), html(&session()));
    let stored = serde_json::to_string(&session()).unwrap();
    let again: CalibrationResult = serde_json::from_str(&stored).unwrap();
    assert_eq!(terminal(&again), terminal(&session()), "a stored result gives the same report");
}

#[test]
fn the_page_has_every_plot_with_every_pose() {
    let page = html(&session());
    assert_eq!(page.matches("<svg ").count(), 6, "target check, view rms, two of the cell, two of the panel");
    // 33 checked poses as points, 73 in each view of the cell and 3 in its legend; 72 + 71 views as bars, none without a fit.
    let points = page.matches("<circle class=\"fit\"").count() + page.matches("<circle class=\"held\"").count();
    assert_eq!(points, 21 + 12);
    assert_eq!(page.matches("<circle class=\"stop-").count(), 2 * (73 + 3));
    let bars = page.matches("<rect class=\"rgb").count() + page.matches("<rect class=\"event rejected").count();
    assert_eq!(bars, 72 + 1);
}

#[test]
fn absent_sections_say_why() {
    let text = terminal(&nothing());
    for expected in [
        "VERDICT: INCONCLUSIVE",
        "  absent: its reference camera was not solved",
        "  absent: rgb: 0 usable views, at least 4 are needed",
        "  absent: both cameras are needed",
        "  absent: there is no hand-eye result",
        "  absent: no pair of poses with a known distance was seen",
        "  absent: the session has no gates, so nothing could be judged",
        "  absent: the session reached no pose",
    ] {
        assert!(text.lines().any(|l| l == expected), "{expected}\n{text}");
    }
    let page = html(&nothing());
    assert!(!page.contains("<svg ") && page.contains("absent: both cameras are needed"));
}

#[test]
fn a_what_if_says_so_first_and_last() {
    let text = terminal(&carried_cameras());
    let at = |word: &str| text.lines().position(|l| l.contains(word)).unwrap_or_else(|| panic!("{word}\n{text}"));
    assert!(at("VERDICT: INCONCLUSIVE (WHAT-IF)") < at("WHAT-IF: NOT AS IT WAS RECORDED"));
    assert!(at("WHAT-IF: NOT AS IT WAS RECORDED") < at("solver.hand_eye=park") && at("solver.hand_eye=park") < 15);
    assert!(text.ends_with("VERDICT: INCONCLUSIVE (WHAT-IF)\n"));
    assert!(text.contains("tcp_from_event") && text.contains("Place of corner 9 in base"));
    assert!(html(&carried_cameras()).contains("INCONCLUSIVE (WHAT-IF)"));
}

#[test]
fn a_missed_gate_is_named_with_its_number() {
    let text = terminal(&session());
    let gate = text.lines().find(|l| l.contains("target-to-TCP max |error|")).unwrap();
    assert!(gate.contains("3.10 mm") && gate.contains("at most 3.00 mm") && gate.contains("MISSED"), "{gate}");
    let mut nan = session();
    nan.stereo.as_mut().unwrap().rms_px = f64::NAN;
    let text = terminal(&nan);
    let gate = text.lines().find(|l| l.contains("stereo rms")).unwrap();
    assert!(gate.contains("MISSED"), "NaN is missed: {gate}");
}

/// Whatever a result file holds, the report is written.
#[test]
fn no_number_stops_a_report() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 0.0, 1e-300] {
        let mut result = session();
        let target = result.checks.target_to_tcp.as_mut().unwrap();
        (target.mean_m, target.truth_m, target.max_m) = (bad, Some(bad), Some(bad));
        target.per_pose.iter_mut().for_each(|p| (p.distance_m, p.leave_one_out_m) = (bad, Some(bad)));
        result.poses.iter_mut().flat_map(|p| p.cameras.values_mut()).for_each(|c| c.rms_px = Some(bad));
        result.poses[0].base_from_tcp = Some(Transform::from_pose_vector([bad, 0.0, 0.0, 0.0, 0.0, 0.0]));
        result.cameras.values_mut().for_each(|c| (c.fx, c.rms_px) = (bad, bad));
        result.hand_eye.as_mut().unwrap().panel_spread_m = Some(bad);
        result.provenance.settings.reject_view_above_px = bad;
        result.provenance.gates.as_mut().unwrap().corner_rate = Some(bad);
        (result.provenance.board.squares_x, result.provenance.board.squares_y) = (0, u32::MAX);
        let lines = terminal(&result);
        assert!(lines.lines().all(|l| l.chars().count() <= 100), "{lines}");
        let page = html(&result);
        for drawing in page.split("<svg ").skip(1) {
            let shapes = drawing.split("</svg>").next().unwrap();
            assert!(!shapes.contains("=\"NaN") && !shapes.contains("=\"inf"), "{bad}");
        }
    }
}
