//! From the keys of a cell file to a [`Cell`]: units, and what one range cannot say.

use super::cameras::{EventRecord, FrameTrigger};
use super::cell::{Cell, ChecksCell, DisplayCell, MotionLimits, Mount, Nominal, RobotCell, RobotDriver};
use super::cell_file::{BoardFile, CellFile, GatesFile, LimitsFile, NominalFile, RobotFile, SettingsFile};
use super::error::Findings;
use super::handheld::RobotChoice;
use super::pose::PoseFile;
use super::robot::{External, Interlock, Line, MotionBy};
use super::{cameras_file, dictionaries};
use crate::board::{Board, BoardError};
use crate::calibration::settings::{Carried, Gates, Settings};
use crate::geometry::{Camera, Transform};

const MODELS: [&str; 1] = ["ur5e"];

pub(super) fn cell(file: CellFile, findings: &mut Findings<'_>) -> Cell {
    check_name("name", &file.name, findings);
    check_cameras(&file, findings);
    check_display(&file.display, findings);
    check_robot_or_none(&file, findings);
    check_trigger(&file, findings);
    let has_arm = file.robot.arm().is_some();
    let board = board(file.board, findings);
    check_square(&file.display, board.square_m * 1e3, findings);
    let checks =
        ChecksCell { corner_id: file.checks.corner_id, target_to_tcp_m: file.checks.target_to_tcp_mm.map(metres) };
    // A board with too few squares has no corners to count.
    if board.check().is_ok() && board.corner(checks.corner_id).is_none() {
        let last = board.corner_count() - 1;
        findings.add("checks.corner_id", format!("is {}, outside 0 to {last}", checks.corner_id));
    }
    Cell {
        name: file.name,
        carried: file.carried,
        robot: match file.robot {
            RobotChoice::Arm(file) => robot(*file, findings),
            RobotChoice::None => RobotCell::none(),
        },
        handheld: file.handheld,
        board,
        display: file.display,
        nominal: match has_arm {
            true => nominal(&file.nominal, file.carried, file.rgb.is_some() && file.event.is_some(), findings),
            false => nominal_by_hand(&file.nominal, findings),
        },
        rgb: file.rgb.map(|c| cameras_file::frame_camera(c, findings)),
        event: file.event.map(|c| cameras_file::event_camera(c, findings)),
        intrinsics: file.intrinsics,
        checks,
        gates: gates(&file.gates),
        settings: settings(&file.settings),
        trajectories: file.trajectories,
        images_per_pose: file.images_per_pose,
        stop_after_failed_poses: file.stop_after_failed_poses,
        sim: file.sim,
    }
}

/// An arm needs trajectories; what is moved by hand can have none.
fn check_robot_or_none(file: &CellFile, findings: &mut Findings<'_>) {
    match (&file.robot, file.trajectories.is_empty()) {
        (RobotChoice::Arm(_), true) if findings.index.find("trajectories").is_none() => {
            findings.missing("", "trajectories", "name at least one trajectory file and its purpose");
        }
        (RobotChoice::Arm(_), true) => {
            findings.add("trajectories", "is empty: name at least one trajectory file and its purpose");
        }
        (RobotChoice::None, false) => findings.add("trajectories", "needs an arm, but this cell has `robot: none`"),
        (RobotChoice::Arm(_), false) | (RobotChoice::None, true) => {}
    }
    let always = file.event.as_ref().is_some_and(|event| event.record == EventRecord::Always);
    if always && file.robot.arm().is_none() {
        findings.add("event.record", "`always` needs an arm, but this cell has `robot: none`: captures only");
    }
}

/// The output that triggers the frame camera must be free for it.
fn check_trigger(file: &CellFile, findings: &mut Findings<'_>) {
    let Some(FrameTrigger::RobotOutput(output)) = file.rgb.as_ref().map(|c| c.trigger) else { return };
    let Some(robot) = file.robot.arm() else {
        return findings.add("rgb.trigger", "is an output of a robot, but this cell has `robot: none`");
    };
    let line = Line::DigitalOutput(output);
    let calibrating = robot.signals.calibrating.is_some_and(|ours| ours.digital_output == output);
    let external = matches!(&robot.motion, MotionBy::External(e) if [e.at_pose, e.captured].contains(&line));
    if calibrating || external {
        let who = if calibrating { "robot.signals.calibrating" } else { "robot.motion.external" };
        findings.add("rgb.trigger", format!("is output {output}, which {who} uses too: give another"));
    }
}

pub(super) fn metres(millimetres: f64) -> f64 {
    millimetres / 1e3
}

/// Names become parts of file names and ids.
pub(super) fn check_name(path: &str, name: &str, findings: &mut Findings<'_>) {
    let fine = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if name.is_empty() || name.len() > 64 || !name.chars().all(fine) {
        findings.add(path, format!("is {name:?}: use 1 to 64 letters, digits, - and _"));
    }
}

fn check_cameras(file: &CellFile, findings: &mut Findings<'_>) {
    let missing = match file.settings.reference_camera {
        _ if file.rgb.is_none() && file.event.is_none() => {
            return findings.add("", "the cell has no camera: give `rgb`, `event` or both");
        }
        Some(Camera::Rgb) => file.rgb.is_none(),
        Some(Camera::Event) => file.event.is_none(),
        None => false,
    };
    if missing {
        findings.add("settings.reference_camera", "names a camera that the cell does not have: name the other or none");
    }
}

fn check_display(display: &DisplayCell, findings: &mut Findings<'_>) {
    let &DisplayCell { cycle_hz, refresh_hz, .. } = display;
    let per_state = refresh_hz / (2.0 * cycle_hz);
    let whole = per_state.round().max(1.0);
    // Panels of 59.94 Hz are called 60.
    let even = (per_state / whole - 1.0).abs() <= 0.005;
    if !even {
        let [faster, slower] = [per_state.floor().max(1.0), per_state.ceil()].map(|n| refresh_hz / (2.0 * n));
        findings.add(
            "display.cycle_hz",
            format!(
                "is {cycle_hz}, which a panel of {refresh_hz} Hz cannot show in whole refreshes: use {slower} or {faster}"
            ),
        );
    }
    if display.panel_px.is_some_and(|px| px.iter().any(|n| !(16..=16384).contains(n))) {
        findings.add("display.panel_px", "is outside 16 to 16384 columns and rows");
    }
}

/// The measured squares must be those of the board: a wrong scale goes one to one into every distance.
fn check_square(display: &DisplayCell, square_mm: f64, findings: &mut Findings<'_>) {
    let all_within = |values: [f64; 2], low: f64, high: f64| values.iter().all(|v| (low..=high).contains(v));
    if display.square_sigma_mm.is_some_and(|s| !all_within(s, 0.0, 10.0)) {
        findings.add("display.square_sigma_mm", "is outside 0 to 10 mm");
    }
    let Some(xy) = display.square_xy_mm else { return };
    if !all_within(xy, 1.0, 1000.0) {
        return findings.add("display.square_xy_mm", "is outside 1 to 1000 mm");
    }
    let mean_mm = (xy[0] + xy[1]) / 2.0;
    // Numbers are written with four decimals.
    if (mean_mm - square_mm).abs() > 1e-3 {
        findings.add(
            "display.square_xy_mm",
            format!("has the mean {mean_mm:.4}, but board.square_mm is {square_mm:.4}: put the mean of what was measured there"),
        );
    }
}

pub(super) fn board(file: BoardFile, findings: &mut Findings<'_>) -> Board {
    let BoardFile { dictionary, squares_x, squares_y, square_mm, marker_mm } = file;
    let board = Board { squares_x, squares_y, square_m: metres(square_mm), marker_m: metres(marker_mm), dictionary };
    match board.check() {
        // Told by their ranges already.
        Ok(()) | Err(BoardError::Squares { .. } | BoardError::Size { .. }) => {}
        Err(BoardError::Marker { .. }) => findings.add(
            "board.marker_mm",
            format!(
                "is {marker_mm}, outside {:.3} to {:.3}: a marker is 0.3 to 0.95 of its square of {square_mm} mm",
                0.3 * square_mm,
                0.95 * square_mm
            ),
        ),
    }
    let markers = u64::from(squares_x) * u64::from(squares_y) / 2;
    match dictionaries::marker_count(&board.dictionary) {
        None => {
            let (found, known) = (&board.dictionary, dictionaries::names());
            findings.add("board.dictionary", format!("is {found:?}, not a dictionary that OpenCV knows: {known}"));
        }
        Some(has) if u64::from(has) < markers => {
            let found = &board.dictionary;
            findings.add("board.dictionary", format!("is {found}, which has {has} markers; the board needs {markers}"));
        }
        Some(_) => {}
    }
    board
}

fn robot(file: RobotFile, findings: &mut Findings<'_>) -> RobotCell {
    if file.urdf.is_none() && !MODELS.contains(&file.model.as_str()) {
        let (found, known) = (&file.model, MODELS.join(", "));
        findings.add("robot.model", format!("is {found:?}, not one of: {known}; other arms need `urdf`"));
    }
    if file.driver == RobotDriver::Ur && file.address.is_none() {
        findings.missing("robot", "address", "the driver `ur` needs the host of the controller");
    }
    for (i, keep_out) in file.keep_out.iter().enumerate() {
        let ordered = keep_out.min_m.iter().zip(keep_out.max_m).all(|(min, max)| *min < max);
        if !ordered {
            findings.add(&format!("robot.keep_out[{i}].min_m"), "is not below max_m in each of x, y and z");
        }
    }
    check_controller(&file, findings);
    RobotCell {
        driver: file.driver,
        model: file.model,
        urdf: file.urdf,
        address: file.address,
        serial: file.serial,
        tcp_offset: file.tcp_offset.transform("robot.tcp_offset", findings),
        payload_kg: file.payload_kg,
        payload_cog_m: file.payload_cog_m,
        home_joints_rad: file.home_joints_deg.map(f64::to_radians),
        limits: limits(&file.limits, file.home_joints_deg, findings),
        allow_reduced: file.allow_reduced,
        stillness: file.stillness,
        keep_out: file.keep_out,
        keep_out_margin_m: metres(file.keep_out_margin_mm),
        tool: file.tool.into_iter().map(Into::into).collect(),
        start_within_rad: file.start_within_deg.to_radians(),
        controller_version: file.controller_version,
        kinematics_checksum: file.kinematics_checksum.map(|c| c.to_ascii_lowercase()),
        speed_slider: file.speed_slider,
        sample_hz: file.sample_hz,
        interlocks: file.interlocks,
        gripper_empty: file.gripper_empty,
        signals: file.signals,
        motion: file.motion,
        return_home: file.return_home,
        load_program: file.load_program,
    }
}

/// What is said about the controller and the signals around it.
fn check_controller(file: &RobotFile, findings: &mut Findings<'_>) {
    let [slowest, fastest] = file.speed_slider;
    if slowest > fastest {
        findings.add("robot.speed_slider", format!("is {slowest} to {fastest}: give the smallest first"));
    }
    let divider = 500.0 / file.sample_hz;
    let whole = (divider - divider.round()).abs() < 1e-9;
    if !whole {
        let [slower, faster] = [divider.ceil(), divider.floor()].map(|n| 500.0 / n);
        findings.add(
            "robot.sample_hz",
            format!("is {}, which is not 500 / n: use {slower:.3} or {faster:.3}", file.sample_hz),
        );
    }
    if let Some(checksum) = &file.kinematics_checksum {
        let is_hex = checksum.len() == 48 && checksum.bytes().all(|b| b.is_ascii_hexdigit());
        if !is_hex {
            findings.add(
                "robot.kinematics_checksum",
                format!("is {checksum:?}: give the 48 hexadecimal digits that `cellcal robot kinematics` prints"),
            );
        }
    }
    if let Some(program) = file.load_program.as_ref().filter(|p| !is_program_name(p)) {
        findings.add("robot.load_program", format!("is {program:?}: give the name of a program, ending in .urp"));
    }
    check_inputs(file, findings);
    if let (Some(calibrating), MotionBy::External(external)) = (&file.signals.calibrating, &file.motion) {
        let ours = Line::DigitalOutput(calibrating.digital_output);
        if [external.at_pose, external.captured].contains(&ours) {
            findings.add("robot.signals.calibrating", "is an output of motion.external too: give another");
        }
    }
    if let Some(version) = &file.controller_version {
        let numbers = version.split('.').all(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
        if !numbers {
            findings.add("robot.controller_version", format!("is {version:?}: give numbers such as \"5.12\""));
        }
    }
    if file.serial.as_ref().is_some_and(|s| s.is_empty() || !s.bytes().all(|b| b.is_ascii_alphanumeric())) {
        findings.add("robot.serial", "is no serial number: use letters and digits, or leave it out");
    }
    if let Some(address) = file.address.as_ref().filter(|a| !is_host(a)) {
        findings.add("robot.address", format!("is {address:?}: give a host name or an IP address, without a port"));
    }
    if let MotionBy::External(External { at_pose, captured, patience_s }) = &file.motion {
        for (key, line) in [("at_pose", at_pose), ("captured", captured)] {
            if let Some(problem) = line.problem() {
                findings.add(&format!("robot.motion.external.{key}"), problem);
            }
        }
        if at_pose == captured {
            findings.add("robot.motion.external.captured", "is the same as at_pose: give another");
        }
        if !(1.0..=3600.0).contains(patience_s) {
            findings.add("robot.motion.external.patience_s", format!("is {patience_s}, outside 1 to 3600"));
        }
    }
}

/// Inputs that can all have their values at once, with meanings that can be shown.
fn check_inputs(file: &RobotFile, findings: &mut Findings<'_>) {
    let interlocks = file.interlocks.iter().enumerate().map(|(i, l)| (format!("robot.interlocks[{i}]"), l));
    let gripper = file.gripper_empty.iter().map(|l| ("robot.gripper_empty".to_owned(), l));
    let all: Vec<_> = interlocks.chain(gripper).collect();
    for (i, (path, input)) in all.iter().enumerate() {
        let shown = !input.meaning.trim().is_empty() && !input.meaning.chars().any(char::is_control);
        if !shown || input.meaning.len() > 200 {
            findings.add(&format!("{path}.meaning"), "must say in 1 to 200 plain characters what the input means");
        }
        let same = |(_, other): &&(String, &Interlock)| other.digital_input == input.digital_input;
        if all[..i].iter().find(same).is_some_and(|(_, other)| other.must_be != input.must_be) {
            let number = input.digital_input;
            findings.add(&format!("{path}.must_be"), format!("contradicts another entry for digital input {number}"));
        }
    }
}

/// A host name, an IPv4 or an IPv6 address.
fn is_host(address: &str) -> bool {
    let name = |c: char| c.is_ascii_alphanumeric() || c == '.' || c == '-' || c == '_';
    let is_name = !address.is_empty() && address.len() <= 253 && address.chars().all(name);
    let of_v6 = |c: char| c.is_ascii_hexdigit() || c == ':' || c == '.';
    is_name || (address.matches(':').count() >= 2 && address.len() <= 45 && address.chars().all(of_v6))
}

/// Sent to the dashboard as one line: no line ends, no surprises.
fn is_program_name(name: &str) -> bool {
    let fine = |c: char| c.is_ascii_alphanumeric() || "-_./ ".contains(c);
    name.ends_with(".urp") && name.len() <= 200 && name.chars().all(fine)
}

fn limits(file: &LimitsFile, home_deg: [f64; 6], findings: &mut Findings<'_>) -> MotionLimits {
    for (i, [min, max]) in file.joints_deg.iter().flatten().enumerate() {
        let path = format!("robot.limits.joints_deg[{i}]");
        if !(*min >= -360.0 && *max <= 360.0 && min < max) {
            findings.add(&path, format!("is {min} to {max}: give the smallest first, inside -360 to 360"));
        } else if !(*min..=*max).contains(&home_deg[i]) {
            findings.add(&format!("robot.home_joints_deg[{i}]"), format!("is {}, outside {min} to {max}", home_deg[i]));
        }
    }
    MotionLimits {
        joint_speed_rad_s: file.joint_speed_rad_s,
        joint_acceleration_rad_s2: file.joint_acceleration_rad_s2,
        tcp_speed_m_s: file.tcp_speed_m_s,
        tcp_acceleration_m_s2: file.tcp_acceleration_m_s2,
        joints_rad: file.joints_deg.map(|joints| joints.map(|range| range.map(f64::to_radians))),
    }
}

fn nominal(file: &NominalFile, carried: Carried, two_cameras: bool, findings: &mut Findings<'_>) -> Nominal {
    let (word, [needs, unused]) = match carried {
        Carried::Target => (
            "target",
            [
                [("base_from_camera", &file.base_from_camera), ("tcp_from_target", &file.tcp_from_target)],
                [("tcp_from_camera", &file.tcp_from_camera), ("base_from_target", &file.base_from_target)],
            ],
        ),
        Carried::Cameras => (
            "cameras",
            [
                [("tcp_from_camera", &file.tcp_from_camera), ("base_from_target", &file.base_from_target)],
                [("base_from_camera", &file.base_from_camera), ("tcp_from_target", &file.tcp_from_target)],
            ],
        ),
    };
    for (key, _) in unused.iter().filter(|(_, pose)| pose.is_some()) {
        findings.add(&format!("nominal.{key}"), format!("does not go with `carried: {word}`: remove it"));
    }
    for (key, _) in needs.iter().filter(|(_, pose)| pose.is_none()) {
        findings.missing("nominal", key, &format!("`carried: {word}` needs it"));
    }
    if two_cameras && file.event_from_rgb.is_none() {
        findings.missing("nominal", "event_from_rgb", "a cell with two cameras needs it");
    }
    let mount = match carried {
        Carried::Target => Mount::Target {
            base_from_camera: optional("base_from_camera", &file.base_from_camera, findings),
            tcp_from_target: optional("tcp_from_target", &file.tcp_from_target, findings),
        },
        Carried::Cameras => Mount::Cameras {
            tcp_from_camera: optional("tcp_from_camera", &file.tcp_from_camera, findings),
            base_from_target: optional("base_from_target", &file.base_from_target, findings),
        },
    };
    let event_from_rgb = file.event_from_rgb.map(|pose| pose.transform("nominal.event_from_rgb", findings));
    Nominal { mount, event_from_rgb }
}

/// Without an arm only the cameras can be said to be somewhere: before each other.
fn nominal_by_hand(file: &NominalFile, findings: &mut Findings<'_>) -> Nominal {
    let NominalFile { base_from_camera, tcp_from_target, tcp_from_camera, base_from_target, event_from_rgb } = file;
    let (base, target) = (("base_from_camera", base_from_camera), ("base_from_target", base_from_target));
    let of_tcp = [("tcp_from_target", tcp_from_target), ("tcp_from_camera", tcp_from_camera)];
    for (key, _) in [base, target].iter().chain(&of_tcp).filter(|(_, pose)| pose.is_some()) {
        findings.add(&format!("nominal.{key}"), "does not go with `robot: none`: remove it");
    }
    let event_from_rgb = event_from_rgb.map(|pose| pose.transform("nominal.event_from_rgb", findings));
    let mount = Mount::Target { base_from_camera: Transform::identity(), tcp_from_target: Transform::identity() };
    Nominal { mount, event_from_rgb }
}

/// The transform; one that is missing has been told already.
fn optional<To, From>(key: &str, pose: &Option<PoseFile>, findings: &mut Findings<'_>) -> Transform<To, From> {
    pose.map_or_else(Transform::identity, |pose| pose.transform(&format!("nominal.{key}"), findings))
}

fn gates(file: &GatesFile) -> Gates {
    Gates {
        rgb_rms_px: file.rgb_rms_px,
        event_rms_px: file.event_rms_px,
        stereo_rms_px: file.stereo_rms_px,
        corner_rate: file.corner_rate,
        target_to_tcp_sigma_m: file.target_to_tcp_sigma_mm.map(metres),
        target_to_tcp_max_m: file.target_to_tcp_max_mm.map(metres),
        target_to_tcp_bias_m: file.target_to_tcp_bias_mm.map(metres),
        base_distance_mae_m: file.base_distance_mae_mm.map(metres),
        base_vector_mae_m: file.base_vector_mae_mm.map(metres),
        panel_spread_m: file.panel_spread_mm.map(metres),
        kinematics_m: file.kinematics_mm.map(metres),
        kinematics_rad: file.kinematics_deg.map(f64::to_radians),
    }
}

fn settings(file: &SettingsFile) -> Settings {
    let usual = Settings::usual(file.method.unwrap_or(Settings::default().method));
    Settings {
        method: file.method.unwrap_or(usual.method),
        reject_view_above_px: file.reject_view_above_px.unwrap_or(usual.reject_view_above_px),
        min_corners: file.min_corners.map_or(usual.min_corners, |n| n as usize),
        pnp: file.pnp.unwrap_or(usual.pnp),
        hand_eye: file.hand_eye.unwrap_or(usual.hand_eye),
        reference_camera: file.reference_camera,
    }
}
