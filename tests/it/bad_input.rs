//! What a user can get wrong, and what they are told. Units of `config` and `import` have the long lists.

use std::path::{Path, PathBuf};

use cellcal::recording::scan::{Scan, scan};

use crate::bench::Bench;
use crate::support::{cellcal, expect, json, stderr, text};

/// The shipped cell with one text replaced, in a folder of its own.
fn cell_with(from: &str, to: &str) -> (tempfile::TempDir, PathBuf) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let shipped = std::fs::read_to_string(root.join("cells/sim.yaml")).unwrap();
    assert!(shipped.contains(from), "the shipped cell has no `{from}`");
    let changed = shipped.replacen(from, to, 1).replace("../trajectories", root.join("trajectories").to_str().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cell.yaml");
    std::fs::write(&path, changed).unwrap();
    (folder, path)
}

#[test]
fn a_wrong_cell_is_refused_with_its_line() {
    let wrong = [
        ("name: sim", "nam: sim", "nam"),
        ("payload_kg: 0.45", "payload_kg: .nan", "payload_kg"),
        ("tcp_speed_m_s: 0.25", "tcp_speed_m_s: 250", "tcp_speed_m_s is 250, outside 0.01 to 1"),
        ("DICT_4X4_50", "DICT_9X9_50", "DICT_9X9_50"),
        ("marker_mm: 7.04", "marker_mm: 9.04", "9.04"),
        ("base_from_camera: {xyz_m: [0.125, -0.563, 0.382]", "base_from_camera: {xyz_m: [125, -563, 382]", "125"),
    ];
    for (from, to, named) in wrong {
        let (_folder, cell) = cell_with(from, to);
        let output = cellcal(&["check", text(&cell)]);
        let said = stderr(&output);
        let refused = output.status.code() == Some(2) && said.contains("cell.yaml:") && said.contains(named);
        assert!(refused, "{to}: exit {:?}\n{said}", output.status.code());
    }
}

#[test]
fn the_shipped_cells_pass_the_check_and_the_schemas_are_those_of_the_program() {
    for cell in ["cells/sim.yaml", "cells/sim-rig.yaml"] {
        let report = json(&expect(0, &["check", cell, "--json"]));
        assert!(report["poses"].as_u64().unwrap() >= 39, "{report:#}");
    }
    // One planned tour does the work of all, and nothing is to be added to it.
    let tour = json(&expect(0, &["check", "cells/sim-tour.yaml", "--json"]));
    assert!(tour["poses"].as_u64().unwrap() <= 20 && tour["duration_s"].as_f64().unwrap() <= 60.0, "{tour:#}");
    assert_eq!((&tour["advice"], &tour["distance_poses"]), (&serde_json::json!([]), &serde_json::json!(4)), "{tour:#}");
    for kind in ["cell", "topics", "trajectory"] {
        let printed = String::from_utf8(expect(0, &["schema", kind]).stdout).unwrap();
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!(".schema/{kind}.json"));
        let shipped = std::fs::read_to_string(&path).unwrap();
        assert!(printed == shipped, "{} is stale: cellcal schema {kind} > {0}", path.display());
    }
}

#[test]
fn a_tour_is_not_planned_where_it_cannot_be_or_would_replace_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let fresh = folder.path().join("tour.yaml");
    let said = stderr(&expect(2, &["plan", "cells/handheld.yaml", "-o", text(&fresh)]));
    assert!(said.contains("handheld.yaml: the cell has `robot: none`") && !fresh.exists(), "{said}");
    std::fs::write(&fresh, "mine").unwrap();
    let said = stderr(&expect(2, &["plan", "cells/sim.yaml", "-o", text(&fresh)]));
    assert!(said.contains("exists already; --force replaces it"), "{said}");
    assert_eq!(std::fs::read_to_string(&fresh).unwrap(), "mine");
}

#[test]
fn a_folder_that_is_no_data_set_says_what_was_looked_for() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("holiday.jpg"), b"x").unwrap();
    let output = cellcal(&["import", text(folder.path()), "-o", text(&folder.path().join("out.mcap"))]);
    let said = stderr(&output);
    for word in ["session.json", "cal_data.yaml", "holiday.jpg"] {
        assert!(said.contains(word), "{word} is not in: {said}");
    }
    assert!(!folder.path().join("out.mcap").exists());
}

#[test]
fn files_of_the_wrong_kind_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let garbage = folder.path().join("garbage");
    std::fs::write(&garbage, [0_u8, 159, 146, 150].repeat(100)).unwrap();
    let wrong: [&[&str]; 6] = [
        &["replay", text(&garbage)],
        &["report", text(&garbage)],
        &["events", "info", text(&garbage)],
        &["check", text(&garbage)],
        &["replay", "does-not-exist.mcap"],
        &["run", "does-not-exist.yaml"],
    ];
    for arguments in wrong {
        let output = cellcal(arguments);
        let said = stderr(&output);
        assert!(matches!(output.status.code(), Some(1 | 2)) && said.starts_with("error: "), "{arguments:?}: {said}");
        assert!(!said.contains("panicked"), "{arguments:?}: {said}");
    }
}

#[test]
fn the_target_is_drawn_for_a_panel() {
    let folder = tempfile::tempdir().unwrap();
    let target = ["target", "png", "cells/sim.yaml", "--panel", "800x480", "-o", text(folder.path()), "--json"];
    let made = json(&expect(0, &target));
    assert_eq!(made["panel_px"], serde_json::json!([800, 480]));
    let read = |name: &str| cellcal::cv::codec::decode_gray(&std::fs::read(folder.path().join(name)).unwrap()).unwrap();
    let (pattern, blended) = (read("pattern.png"), read("blended.png"));
    assert_eq!((pattern.width, pattern.height), (800, 480));
    for (a, b) in pattern.pixels.iter().zip(&blended.pixels) {
        assert!(matches!((a, b), (0, 153) | (255, 255)), "{a} became {b}");
    }
    let view = cellcal::vision::frame_view(
        &cellcal::board::Board {
            squares_x: 7,
            squares_y: 5,
            square_m: 0.0088,
            marker_m: 0.00704,
            dictionary: "DICT_4X4_50".into(),
        },
        &pattern,
    );
    assert_eq!(view.unwrap().corners.len(), 24);
}

#[test]
fn no_damage_makes_the_reader_ask_for_the_moon() {
    let bench = Bench::new(Vec::new());
    let recording = bench.run(|_| ()).unwrap().recording;
    let whole = std::fs::read(recording).unwrap();
    let captures = |scan: &Scan| scan.messages.len();
    let all = captures(&scan(&whole));
    // Steps that fall on lengths, checksums and compressed data alike.
    for at in (8..whole.len()).step_by(whole.len() / 400) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0xff;
        let read = scan(&bytes);
        assert!(captures(&read) <= all, "byte {at}: {} of {all} messages", captures(&read));
    }
}
