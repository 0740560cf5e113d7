//! Files as people get them wrong, and what they are told, to the letter.

use super::*;

const CELL: &str = r#"name: sim
carried: target
robot:
  driver: sim
  model: ur5e
  tcp_offset: {xyz_mm: [0, 0, 40], rotvec_deg: [0, 0, 0]}
  payload_kg: 0.45
  home_joints_deg: [92, -62, 128, -66, 92, 0]
board: {dictionary: DICT_4X4_50, squares_x: 7, squares_y: 5, square_mm: 8.8, marker_mm: 7.04}
display: {alpha: 0.6, cycle_hz: 15}
event:
  driver: sim
  width: 1280
  height: 720
  lens: 12 mm
  focal_length_mm: 12
  pixel_pitch_um: 4.86
nominal:
  base_from_camera: {xyz_m: [0.125, -0.563, 0.382], rotvec_deg: [180, 0, 0]}
  tcp_from_target: {xyz_mm: [-35.2, 9, 49.6], rotvec_deg: [90, 0, 0]}
trajectories:
  - {file: a.yaml, purpose: hand_eye}
"#;

const TRAJECTORY: &str = "name: t
segments:
  - pattern: views
    poses:
      - view: {centre_mm: [0, 0, 290]}
  - pattern: grid
    move: linear
    view: {centre_m: [0, 0, 0.29], rotvec_deg: [0, 10, 0]}
    columns: 3
    rows: 2
    step_mm: [20, 10]
";

/// The text with one part replaced; the part must be there, once.
fn with(text: &str, from: &str, to: &str) -> String {
    assert_eq!(text.matches(from).count(), 1, "{from:?}");
    text.replace(from, to)
}

#[track_caller]
fn cell_says(from: &str, to: &str, message: &str) {
    let error = parse_cell(&with(CELL, from, to), "cells/a.yaml").unwrap_err();
    assert_eq!(error.to_string(), message);
}

#[track_caller]
fn trajectory_says(from: &str, to: &str, message: &str) {
    let error = parse_trajectory(&with(TRAJECTORY, from, to), "t.yaml").unwrap_err();
    assert_eq!(error.to_string(), message);
}

#[test]
fn a_small_cell_is_read_in_metres_and_radians() {
    let cell = parse_cell(CELL, "a.yaml").unwrap();
    assert_eq!(cell.board.square_m, 0.0088);
    assert_eq!(cell.robot.tcp_offset.translation_m(), [0.0, 0.0, 0.04]);
    assert_eq!(cell.robot.home_joints_rad[1], (-62f64).to_radians());
    assert_eq!(cell.robot.limits.joint_speed_rad_s, 1.05);
    assert_eq!(cell.robot.stillness.min_samples, 20);
    assert_eq!(cell.event.as_ref().unwrap().focal_length_m, 0.012);
    assert_eq!(cell.intrinsics, IntrinsicsSource::Solve);
    assert_eq!(cell.reference_camera(), crate::geometry::Camera::Event);
    let camera = cell.nominal_camera(crate::geometry::Camera::Event).unwrap();
    assert!((camera.fx - 0.012 / 4.86e-6).abs() < 1e-9);
}

#[test]
fn intrinsics_come_from_a_file_where_it_is_named() {
    let text = format!("{CELL}intrinsics: {{from: ../results/camera.json}}\n");
    assert_eq!(parse_cell(&text, "").unwrap().intrinsics, IntrinsicsSource::From("../results/camera.json".into()));
}

#[test]
fn sections_of_the_simulator_are_kept_as_maps() {
    let cell = parse_cell(&format!("{CELL}sim: {{seed: 7, robot: {{joint_offset_rad: 1e-4}}}}\n"), "").unwrap();
    let sim = cell.sim.unwrap();
    assert_eq!((sim.seed, sim.robot.unwrap()["joint_offset_rad"].as_f64()), (7, Some(1e-4)));
    let error = parse_cell(&format!("{CELL}sim: {{display: 3}}\n"), "a.yaml").unwrap_err();
    assert_eq!(error.to_string(), "a.yaml:23:16: sim.display is 3, not a mapping of keys");
    let error = parse_cell(&format!("{CELL}sim: {{display: {{bow_m: .inf}}}}\n"), "a.yaml").unwrap_err();
    assert_eq!(error.to_string(), "a.yaml:23:24: sim.display.bow_m is inf: give a finite number");
}

#[test]
fn a_value_outside_its_range() {
    cell_says(
        "payload_kg: 0.45",
        "payload_kg: 0.45\n  limits: {tcp_speed_m_s: 2.5}",
        "cells/a.yaml:8:27: robot.limits.tcp_speed_m_s is 2.5, outside 0.01 to 1",
    );
    cell_says("alpha: 0.6", "alpha: -1", "cells/a.yaml:10:18: display.alpha is -1, outside 0 to 0.95");
    cell_says("width: 1280", "width: 0", "cells/a.yaml:13:10: event.width is 0, outside 64 to 4096");
    cell_says("squares_x: 7", "squares_x: 0", "cells/a.yaml:9:45: board.squares_x is 0, outside 3 to 100");
}

#[test]
fn a_value_in_another_unit() {
    cell_says(
        "[0.125, -0.563, 0.382]",
        "[0.125, -563, 0.382]",
        "cells/a.yaml:19:37: nominal.base_from_camera.xyz_m[1] is -563, outside -10 to 10: is it in millimetres? this key takes metres",
    );
    cell_says(
        "square_mm: 8.8, marker_mm: 7.04",
        "square_mm: 0.0088, marker_mm: 0.00704",
        "cells/a.yaml:9:73: board.square_mm is 0.0088, outside 1 to 1000: is it in metres? this key takes millimetres\n\
         error: cells/a.yaml:9:92: board.marker_mm is 0.00704, outside 0.3 to 950: is it in metres? this key takes millimetres",
    );
    cell_says(
        "rotvec_deg: [90, 0, 0]",
        "rotvec_rad: [90, 0, 0]",
        "cells/a.yaml:20:60: nominal.tcp_from_target.rotvec_rad[0] is 90, outside -6.3 to 6.3: is it in degrees? this key takes radians",
    );
}

#[test]
fn everything_out_of_range_is_told_at_once() {
    let text = with(CELL, "alpha: 0.6, cycle_hz: 15", "alpha: 7, cycle_hz: 9000");
    let error = parse_cell(&with(&text, "payload_kg: 0.45", "payload_kg: -3"), "a.yaml").unwrap_err();
    let lines: Vec<_> = error.problems.iter().map(|p| (p.line, p.message.as_str())).collect();
    assert_eq!(
        lines,
        [
            (7, "robot.payload_kg is -3, outside 0 to 50"),
            (10, "display.alpha is 7, outside 0 to 0.95"),
            (10, "display.cycle_hz is 9000, outside 1 to 120"),
        ]
    );
}

#[test]
fn numbers_that_are_not_finite() {
    cell_says(
        "payload_kg: 0.45",
        "payload_kg: .nan",
        "cells/a.yaml:7:15: robot.payload_kg is NaN: give a finite number",
    );
    cell_says(
        "xyz_mm: [0, 0, 40]",
        "xyz_mm: [0, -.inf, 40]",
        "cells/a.yaml:6:28: robot.tcp_offset.xyz_mm[1] is -inf: give a finite number",
    );
    cell_says(
        "payload_kg: 0.45",
        "payload_kg: '.nan'",
        "cells/a.yaml:7:15: robot.payload_kg is \".nan\": give a finite number",
    );
}

#[test]
fn keys_that_are_missing_doubled_or_unknown() {
    cell_says("name: sim\n", "", "cells/a.yaml:1:1: key `name` is missing");
    cell_says("  payload_kg: 0.45\n", "", "cells/a.yaml:4:3: robot has no key `payload_kg`");
    cell_says("squares_x: 7, ", "", "cells/a.yaml:9:8: board has no key `squares_x`");
    cell_says(
        "payload_kg: 0.45",
        "payload_kg: 0.45\n  payload_kg: 0.5",
        "cells/a.yaml:8:3: robot.payload_kg is given twice: remove one of the keys `payload_kg`",
    );
    cell_says(
        "cycle_hz: 15",
        "cycle_h: 15",
        "cells/a.yaml:10:23: unknown key `cycle_h` in `display`: did you mean `cycle_hz`? (known: alpha, cycle_hz, refresh_hz, panel_px, square_xy_mm, square_sigma_mm)",
    );
    cell_says(
        "square_mm: 8.8",
        "square_m: 0.0088",
        "cells/a.yaml:9:62: unknown key `square_m` in `board`: did you mean `square_mm`? (known: dictionary, squares_x, squares_y, square_mm, marker_mm)",
    );
    cell_says(
        "  - {file: a.yaml, purpose: hand_eye}",
        "  - {file: a.yaml, purpose: hand_eye, repeat: 2}",
        "cells/a.yaml:22:39: unknown key `repeat` in `trajectories[0]` (known: file, purpose)",
    );
}

#[test]
fn values_of_the_wrong_type() {
    cell_says(
        "payload_kg: 0.45",
        "payload_kg: heavy",
        "cells/a.yaml:7:15: robot.payload_kg is \"heavy\", not a number",
    );
    cell_says(
        "width: 1280",
        "width: 1280.5",
        "cells/a.yaml:13:10: event.width is 1280.5, not a whole number, 0 or more",
    );
    cell_says("name: sim", "name: [sim]", "cells/a.yaml:1:7: name is a list of 1, not text");
    cell_says("name: sim", "name:", "cells/a.yaml:1:5: name is empty, not text");
    cell_says(
        "home_joints_deg: [92, -62, 128, -66, 92, 0]",
        "home_joints_deg: [92, -62, 128, -66, 92]",
        "cells/a.yaml:8:20: robot.home_joints_deg has 5 values, not 6",
    );
    cell_says(
        "carried: target",
        "carried: camera",
        "cells/a.yaml:2:10: carried is \"camera\", not one of: target, cameras",
    );
    cell_says("board: {", "board: 3 #", "cells/a.yaml:9:8: board is 3, not a mapping of keys");
    cell_says(
        "trajectories:\n  - {file: a.yaml, purpose: hand_eye}",
        "trajectories: a.yaml",
        "cells/a.yaml:21:15: trajectories is \"a.yaml\", not a list",
    );
}

#[test]
fn what_is_no_yaml() {
    cell_says(
        "name: sim\ncarried",
        "name: sim\n\tcarried",
        "cells/a.yaml:2:1: not YAML: a tab in the indentation; indent with spaces",
    );
    let says = |text: &str| parse_cell(text, "a.yaml").unwrap_err().to_string();
    assert_eq!(says(""), "a.yaml:1:1: the file is empty");
    assert_eq!(says("# only a comment\n"), "a.yaml:2:1: the file is empty");
    assert_eq!(says("- a\n"), "a.yaml:1:1: the file is a list of 1, not a mapping of keys");
    assert_eq!(says("name: {\n"), "a.yaml:1:7: not YAML: unclosed bracket '{'");
    assert_eq!(
        says(&format!("{CELL}---\nname: b\n")),
        "a.yaml:24:1: a second YAML document begins: one file holds one document"
    );
}

#[test]
fn a_board_that_cannot_be() {
    cell_says(
        "marker_mm: 7.04",
        "marker_mm: 8.8",
        "cells/a.yaml:9:89: board.marker_mm is 8.8, outside 2.640 to 8.360: a marker is 0.3 to 0.95 of its square of 8.8 mm",
    );
    let error = parse_cell(&with(CELL, "DICT_4X4_50", "DICT_9X9_50"), "a.yaml").unwrap_err().to_string();
    assert!(
        error.starts_with(
            "a.yaml:9:21: board.dictionary is \"DICT_9X9_50\", not a dictionary that OpenCV knows: DICT_4X4_50, "
        ),
        "{error}"
    );
    assert!(error.contains("DICT_7X7_1000, DICT_ARUCO_ORIGINAL, DICT_APRILTAG_16h5"), "{error}");
    cell_says(
        "squares_x: 7, squares_y: 5",
        "squares_x: 12, squares_y: 9",
        "cells/a.yaml:9:21: board.dictionary is DICT_4X4_50, which has 50 markers; the board needs 54",
    );
    let text = format!("{CELL}checks: {{corner_id: 24}}\n");
    let error = parse_cell(&text, "a.yaml").unwrap_err();
    assert_eq!(error.to_string(), "a.yaml:23:21: checks.corner_id is 24, outside 0 to 23");
}

#[test]
fn a_display_that_cannot_show_the_cycle() {
    cell_says(
        "cycle_hz: 15",
        "cycle_hz: 15, refresh_hz: 75",
        "cells/a.yaml:10:33: display.cycle_hz is 15, which a panel of 75 Hz cannot show in whole refreshes: use 12.5 or 18.75",
    );
    let text = with(CELL, "cycle_hz: 15", "cycle_hz: 15, refresh_hz: 59.94");
    assert!(parse_cell(&text, "").is_ok());
}

#[test]
fn keys_that_do_not_go_together() {
    cell_says(
        "carried: target",
        "carried: cameras",
        "cells/a.yaml:19:3: nominal has no key `base_from_target`: `carried: cameras` needs it\n\
         error: cells/a.yaml:19:3: nominal has no key `tcp_from_camera`: `carried: cameras` needs it\n\
         error: cells/a.yaml:19:21: nominal.base_from_camera does not go with `carried: cameras`: remove it\n\
         error: cells/a.yaml:20:20: nominal.tcp_from_target does not go with `carried: cameras`: remove it",
    );
    cell_says(
        "driver: sim\n  model",
        "driver: ur\n  model",
        "cells/a.yaml:4:3: robot has no key `address`: the driver `ur` needs the host of the controller",
    );
    cell_says(
        "xyz_mm: [0, 0, 40]",
        "xyz_mm: [0, 0, 40], xyz_m: [0, 0, 0.04]",
        "cells/a.yaml:6:24: robot.tcp_offset.xyz_mm stands beside xyz_m: give one of the two",
    );
    cell_says(
        ", rotvec_deg: [180, 0, 0]",
        "",
        "cells/a.yaml:19:21: nominal.base_from_camera has no key `rotvec_deg`: give the rotation as rotvec_deg or rotvec_rad, [0, 0, 0] for none",
    );
    cell_says(
        "trajectories:\n  - {file: a.yaml, purpose: hand_eye}",
        "trajectories: []\nsettings: {reference_camera: rgb}",
        "cells/a.yaml:21:15: trajectories is empty: name at least one trajectory file and its purpose\n\
         error: cells/a.yaml:22:30: settings.reference_camera names a camera that the cell does not have: name the other or none",
    );
    cell_says(
        "payload_kg: 0.45",
        "payload_kg: 0.45\n  keep_out: [{name: post, min_m: [0, 0, 1], max_m: [1, 1, 0]}]",
        "cells/a.yaml:8:34: robot.keep_out[0].min_m is not below max_m in each of x, y and z",
    );
    cell_says(
        "model: ur5e",
        "model: ur99",
        "cells/a.yaml:5:10: robot.model is \"ur99\", not one of: ur5e; other arms need `urdf`",
    );
    cell_says(
        "payload_kg: 0.45",
        "payload_kg: 0.45\n  limits: {joints_deg: [[0, 90], [-180, 0], [-150, 150], [90, 0], [-360, 360], [-360, 360]]}",
        "cells/a.yaml:8:58: robot.limits.joints_deg[3] is 90 to 0: give the smallest first, inside -360 to 360\n\
         error: cells/a.yaml:9:21: robot.home_joints_deg[0] is 92, outside 0 to 90",
    );
}

#[test]
fn a_cell_without_a_camera() {
    let text: String = CELL
        .lines()
        .filter(|l| !l.starts_with("event") && !EVENT_KEYS.iter().any(|k| l.contains(k)))
        .map(|l| format!("{l}\n"))
        .collect();
    let text = with(&text, "robot:\n", "robot:\n  driver: sim\n");
    let error = parse_cell(&text, "a.yaml").unwrap_err();
    assert_eq!(error.to_string(), "a.yaml:1:1: the cell has no camera: give `rgb`, `event` or both");
}

const EVENT_KEYS: [&str; 6] = ["driver", "width", "height", "lens", "focal", "pitch"];

#[test]
fn a_small_trajectory_is_read() {
    let trajectory = parse_trajectory(TRAJECTORY, "t.yaml").unwrap();
    assert_eq!((trajectory.name.as_str(), trajectory.segments.len()), ("t", 2));
    assert_eq!(trajectory.segments[0].motion, Motion::Joint);
    assert_eq!(trajectory.segments[1].motion, Motion::Linear);
    let Pattern::Grid { columns: 3, rows: 2, step_m, view } = &trajectory.segments[1].pattern else {
        panic!("{trajectory:?}")
    };
    assert_eq!((*step_m, view.centre_m), ([0.02, 0.01], [0.0, 0.0, 0.29]));
}

#[test]
fn trajectories_as_people_get_them_wrong() {
    let says = |text: &str| parse_trajectory(text, "t.yaml").unwrap_err().to_string();
    assert_eq!(
        says("name: t\nsegments: []\n"),
        "t.yaml:2:11: segments is empty: a trajectory needs at least one segment"
    );
    assert_eq!(
        says("name: t\nsegments:\n  - pattern: tcp\n    poses: []\n"),
        "t.yaml:4:12: segments[0].poses is empty: give at least one"
    );
    assert_eq!(
        says(
            "name: t\nsegments:\n  - pattern: tcp\n    poses:\n      - pose: {xyz_m: [400, 0, 0.3], rotvec_deg: [0, 0, 0]}\n"
        ),
        "t.yaml:5:24: segments[0].poses[0].pose.xyz_m[0] is 400, outside -10 to 10: is it in millimetres? this key takes metres"
    );
    assert_eq!(
        says("name: a b\nsegments:\n  - pattern: joints\n    poses: [{joints_deg: [0, 0, 0, 0, 0, 0]}]\n"),
        "t.yaml:1:7: name is \"a b\": use 1 to 64 letters, digits, - and _"
    );
    assert_eq!(
        says(
            "name: t\nsegments:\n  - pattern: joints\n    poses:\n      - {id: p, joints_deg: [0, 0, 0, 0, 0, 0]}\n      - {id: p, joints_deg: [0, 0, 0, 0, 0, 500]}\n"
        ),
        "t.yaml:6:14: segments[0].poses[1].id is \"p\", which an earlier pose has: ids must differ\n\
         error: t.yaml:6:45: segments[0].poses[1].joints_deg[5] is 500, outside -360 to 360"
    );
}

#[test]
fn segments_keep_line_and_column_of_their_keys() {
    trajectory_says(
        "pattern: grid",
        "pattern: gird",
        "t.yaml:6:14: segments[1].pattern is \"gird\", not one of: joints, tcp, views, grid, depth, roll, sweep, orbit, translate",
    );
    trajectory_says("rows: 2", "rows: 0", "t.yaml:10:11: segments[1].rows is 0, outside 1 to 100");
    trajectory_says("rows: 2", "rows: two", "t.yaml:10:11: segments[1].rows is \"two\", not a whole number, 0 or more");
    trajectory_says("    rows: 2\n", "", "t.yaml:6:5: segments[1] has no key `rows`");
    trajectory_says(
        "rows: 2",
        "rows: 2\n    count: 3",
        "t.yaml:11:5: unknown key `count` in `segments[1]` (known: move, purpose, camera, view, columns, rows, step_mm)",
    );
    trajectory_says(
        "- pattern: grid\n    move: linear",
        "- move: linear\n    pattern: grid",
        "t.yaml:6:5: segments[1] does not begin with its pattern: write `- pattern: NAME` first, one of: joints, tcp, views, grid, depth, roll, sweep, orbit, translate",
    );
    trajectory_says(
        "centre_m: [0, 0, 0.29]",
        "centre_m: [0, 0, 290]",
        "t.yaml:8:29: segments[1].view.centre_m[2] is 290, outside -10 to 10: is it in millimetres? this key takes metres",
    );
    trajectory_says(
        "centre_mm: [0, 0, 290]",
        "centre_mm: [0, 0, -290]",
        "t.yaml:5:34: segments[0].poses[0].view.centre_mm[2] is not before the camera: z points away from the camera and must be above 0",
    );
}

#[test]
fn pairs_that_cannot_be() {
    let text = |start: &str, displacement: &str| {
        format!(
            "name: t\nsegments:\n  - pattern: translate\n    pairs:\n      - name: a\n        start: {start}\n        displacement_mm: {displacement}\n"
        )
    };
    let says = |text: String| parse_trajectory(&text, "t.yaml").unwrap_err().to_string();
    assert_eq!(
        says(text("{}", "[0, 0, 20]")),
        "t.yaml:6:16: segments[0].pairs[0].start must have one of `view` and `tcp`"
    );
    let view = "{view: {centre_mm: [0, 0, 290]}}";
    assert_eq!(
        says(text(view, "[0, 0, 0.020]")),
        "t.yaml:7:26: segments[0].pairs[0].displacement_mm is shorter than 1 mm: the two poses must differ"
    );
    assert_eq!(
        says(text(view, "[0, 0, 40]\n        known_mm: 60")),
        "t.yaml:8:19: segments[0].pairs[0].known_mm is 60, but the displacement is 40.000 mm long: they mean the same distance"
    );
    let good = parse_trajectory(&text(view, "[30, 40, 0]"), "t.yaml").unwrap();
    let Pattern::Translate(pairs) = &good.segments[0].pattern else { panic!("{good:?}") };
    assert!((pairs[0].truth_m() - 0.05).abs() < 1e-15);
    assert_eq!(good.segments[0].motion, Motion::Linear);
}

#[test]
fn schemas_know_ranges_and_patterns() {
    let cell = cell_schema();
    assert_eq!(cell.pointer("/$defs/MotionLimits/properties/tcp_speed_m_s/maximum").unwrap().as_f64(), Some(1.0));
    assert_eq!(cell["additionalProperties"], false);
    let trajectory = trajectory_schema();
    let segments = trajectory.pointer("/$defs/Segment/oneOf").unwrap().as_array().unwrap();
    let patterns: Vec<_> = segments.iter().map(|s| s.pointer("/properties/pattern/const").unwrap().clone()).collect();
    assert_eq!(patterns[3], "grid");
    assert_eq!(patterns.len(), 9);
}

#[test]
fn no_cut_of_a_file_panics() {
    for text in [CELL, TRAJECTORY] {
        for end in (0..text.len()).step_by(3) {
            assert!(parse_cell(&text[..end], "c").is_err());
            if let Err(error) = parse_trajectory(&text[..end], "t") {
                assert!(error.problems.iter().all(|p| p.line > 0 && p.column > 0 && !p.message.is_empty()));
            }
        }
    }
}
