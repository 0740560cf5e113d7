//! Plans of small trajectories, with poses that must be refused, and of the shipped files.

use std::path::{Path, PathBuf};

use super::*;
use crate::config::{KeepOut, RobotCell, parse_cell, parse_trajectory};
use crate::geometry::{kinematics::Dh, rotation};

/// The folder with `cells` and `trajectories`.
fn shipped() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn sim() -> Cell {
    cell("sim.yaml")
}

fn cell(name: &str) -> Cell {
    parse_cell(&text(&shipped().join("cells").join(name)), name).unwrap_or_else(|e| panic!("{e}"))
}

/// The trajectories that a shipped cell names.
fn trajectories(cell: &Cell) -> Vec<(PoseKind, Trajectory)> {
    let read = |file: &str| parse_trajectory(&text(&shipped().join("cells").join(file)), file);
    let all = cell.trajectories.iter();
    all.map(|used| (used.purpose, read(&used.file).unwrap_or_else(|e| panic!("{e}")))).collect()
}

/// A plan of the segments in `yaml` for a hand-eye fit.
fn plan_of(cell: &Cell, yaml: &str) -> Result<Plan, PlanError> {
    let text = format!("name: t\nsegments:\n{yaml}");
    expand(cell, &[(PoseKind::HandEye, parse_trajectory(&text, "t.yaml").unwrap_or_else(|e| panic!("{e}")))])
}

fn refusal(cell: &Cell, yaml: &str) -> String {
    plan_of(cell, yaml).unwrap_err().to_string()
}

const CENTRE: &str = "{centre_mm: [17.2, 0, 290]}";

/// The view of the reference camera at a planned pose: centre of the board, metres, and rotation vector, rad.
fn view(cell: &Cell, pose: &PlannedPose) -> ([f64; 3], [f64; 3]) {
    let camera_from_target = cell.nominal.mount.camera_from_target(pose.base_from_tcp);
    ((camera_from_target * cell.board.centre()).xyz_m(), camera_from_target.rotation_vector_rad())
}

fn assert_near(found: [f64; 3], known: [f64; 3], tolerance: f64) {
    assert!(found.iter().zip(known).all(|(a, b)| (a - b).abs() < tolerance), "{found:?} is not {known:?}");
}

#[test]
fn a_view_becomes_the_pose_that_shows_it() {
    let cell = sim();
    let plan = plan_of(
        &cell,
        "  - {pattern: views, poses: [{id: here, view: {centre_mm: [10, -5, 300], rotvec_deg: [12, 7, -20]}}]}\n",
    )
    .unwrap();
    let pose = &plan.poses[0];
    assert_eq!(pose.id, "here");
    let (centre_m, rotvec_rad) = view(&cell, pose);
    assert_near(centre_m, [0.010, -0.005, 0.300], 1e-12);
    assert_near(rotvec_rad, [12.0, 7.0, -20.0].map(f64::to_radians), 1e-12);
    let reached = Arm::ur5e().forward(&pose.joints_rad) * cell.robot.tcp_offset;
    assert!(reached.distance_to_m(&pose.base_from_tcp) < 1e-7 && reached.angle_to_rad(&pose.base_from_tcp) < 1e-7);
    assert_eq!(pose.corners_in_view, [(Camera::Rgb, 24), (Camera::Event, 24)]);
}

#[test]
fn a_view_of_the_frame_camera_is_seen_from_there() {
    let cell = sim();
    let plan =
        plan_of(&cell, "  - {pattern: views, camera: rgb, poses: [{view: {centre_mm: [-20, 0, 300]}}]}\n").unwrap();
    // event_from_rgb moves it by 34.4 mm along x.
    assert_near(view(&cell, &plan.poses[0]).0, [0.0144, 0.0, 0.300], 1e-12);
    let alone = Cell { rgb: None, ..cell };
    let plan =
        plan_of(&alone, "  - {pattern: views, camera: rgb, poses: [{view: {centre_mm: [-20, 0, 300]}}]}\n").unwrap();
    assert_near(view(&alone, &plan.poses[0]).0, [-0.020, 0.0, 0.300], 1e-12);
    assert_eq!(
        plan.warnings[0],
        "t.yaml: its views are for the rgb camera, which the cell does not have; taken for event"
    );
}

#[test]
fn patterns_make_the_stops_they_say() {
    let cell = sim();
    let centres = |yaml: &str| -> Vec<[i64; 3]> {
        let plan = plan_of(&cell, yaml).unwrap_or_else(|e| panic!("{e}"));
        plan.poses.iter().map(|p| view(&cell, p).0.map(|v| (v * 1e4).round() as i64)).collect()
    };
    let grid = centres(&format!("  - {{pattern: grid, view: {CENTRE}, columns: 2, rows: 2, step_mm: [20, 10]}}\n"));
    assert_eq!(grid, [[72, -50, 2900], [272, -50, 2900], [272, 50, 2900], [72, 50, 2900]]);
    let depth = centres(&format!("  - {{pattern: depth, view: {CENTRE}, count: 3, step_mm: 10}}\n"));
    assert_eq!(depth, [[172, 0, 2800], [172, 0, 2900], [172, 0, 3000]]);
    let sweep =
        centres(&format!("  - {{pattern: sweep, from: {CENTRE}, to: {{centre_mm: [19.2, 4, 310]}}, count: 3}}\n"));
    assert_eq!(sweep, [[172, 0, 2900], [182, 20, 3000], [192, 40, 3100]]);
}

#[test]
fn turns_are_about_the_centre_of_the_board() {
    let cell = sim();
    let roll = plan_of(&cell, &format!("  - {{pattern: roll, view: {CENTRE}, count: 3, step_deg: 15}}\n")).unwrap();
    for (pose, deg) in roll.poses.iter().zip([-15.0, 0.0, 15.0]) {
        let (centre_m, rotvec_rad) = view(&cell, pose);
        assert_near(centre_m, [0.0172, 0.0, 0.290], 1e-12);
        assert_near(rotvec_rad, [0.0, 0.0, f64::to_radians(deg)], 1e-12);
    }
    let orbit = "  - pattern: orbit\n    rings:\n      - {distance_mm: 300, offset_mm: [17.2, 0], tilt_deg: 20, count: 5, rolls_deg: [0, 30]}\n";
    for (i, pose) in plan_of(&cell, orbit).unwrap().poses.iter().enumerate() {
        let (centre_m, rotvec_rad) = view(&cell, pose);
        assert_near(centre_m, [0.0172, 0.0, 0.300], 1e-12);
        // The normal of the board is tilted by 20 deg whatever the roll.
        let normal = rotation::from_vector(rotvec_rad) * nalgebra::Vector3::z();
        assert!((normal.z.acos().to_degrees() - 20.0).abs() < 1e-9, "{i}: {normal:?}");
    }
}

#[test]
fn a_pair_is_two_poses_apart_by_its_displacement() {
    let cell = sim();
    let plan = plan_of(
        &cell,
        &format!("  - pattern: translate\n    pairs: [{{name: p, start: {{view: {CENTRE}}}, displacement_mm: [0, 30, -16]}}]\n"),
    )
    .unwrap();
    let [a, b] = plan.poses.as_slice() else { panic!("{plan:?}") };
    assert_eq!((a.id.as_str(), b.id.as_str()), ("t-p-a", "t-p-b"));
    assert!((b.pair.as_ref().unwrap().truth_m - 0.034).abs() < 1e-12);
    let (from, to) = (a.base_from_tcp.translation_m(), b.base_from_tcp.translation_m());
    assert_near(std::array::from_fn(|i| to[i] - from[i]), [0.0, 0.030, -0.016], 1e-12);
    assert!(a.base_from_tcp.angle_to_rad(&b.base_from_tcp) < 1e-12);
    assert!(matches!(a.target, MoveTarget::Linear { .. }), "{a:?}");
    assert!(matches!(b.target, MoveTarget::Linear { .. }), "{b:?}");
}

#[test]
fn poses_that_cannot_be_visited() {
    let cell = sim();
    let tcp =
        |xyz: &str| format!("  - {{pattern: tcp, poses: [{{pose: {{xyz_m: {xyz}, rotvec_deg: [90, 0, 0]}}}}]}}\n");
    let far = refusal(&cell, &tcp("[0.15, -1.6, 0.1]"));
    assert!(far.starts_with("t.yaml: pose t-01 is out of reach: the arm gets no nearer than "), "{far}");
    let aside = refusal(&cell, &tcp("[0.35, -0.45, 0.1]"));
    assert_eq!(
        aside,
        "t.yaml: pose t-01 shows no corner of the board to any camera; move it, or correct `nominal` of the cell"
    );
    let robot = RobotCell { keep_out: Vec::new(), ..cell.robot.clone() };
    let open = Cell { robot, ..cell.clone() };
    let behind =
        refusal(&open, "  - {pattern: views, poses: [{view: {centre_mm: [0, 0, 300], rotvec_deg: [0, 180, 0]}}]}\n");
    assert!(
        behind.contains("t-01 turns the back of the board to the rgb camera") || behind.contains("t-01 needs"),
        "{behind}"
    );
    let twice = "  - {pattern: views, poses: [{id: t-02, view: {centre_mm: [17, 0, 290]}}, {view: {centre_mm: [17, 0, 290]}}]}\n";
    assert_eq!(
        refusal(&cell, twice),
        "t.yaml: pose t-02 has an id that another pose of the session has; rename one, or use each trajectory once"
    );
}

#[test]
fn a_goal_outside_the_joint_limits() {
    let mut cell = sim();
    let yaml = "  - {pattern: joints, poses: [{joints_deg: [92, -62, 200, -66, 92, 0]}]}\n";
    assert_eq!(
        refusal(&cell, yaml),
        "t.yaml: pose t-01 needs elbow_joint at 200.0 deg, outside -180.0 to 180.0; move it, or correct `limits.joints_deg`"
    );
    let mut limits = [[-6.3, 6.3]; 6];
    limits[0] = [1.0, 1.5];
    cell.robot.limits.joints_rad = Some(limits);
    cell.robot.home_joints_rad[0] = 1.4;
    let refused = refusal(&cell, &format!("  - {{pattern: views, poses: [{{view: {CENTRE}}}]}}\n"));
    assert!(refused.starts_with("t.yaml: pose t-01 needs shoulder_pan_joint at "), "{refused}");
}

#[test]
fn a_box_on_the_way_is_seen() {
    let mut cell = sim();
    let yaml = "  - {pattern: grid, view: {centre_mm: [17.2, 20, 290]}, columns: 2, rows: 1, step_mm: [40, 0]}\n";
    let plan = plan_of(&cell, yaml).unwrap();
    let middle_m = plan.poses[0].base_from_tcp.interpolate(&plan.poses[1].base_from_tcp, 0.5).translation_m();
    let around = |by: f64| middle_m.map(|v| v + by);
    // Only the way between the two poses enters it.
    cell.robot.keep_out.push(KeepOut { name: "post".into(), min_m: around(-0.004), max_m: around(0.004) });
    let refused = refusal(&cell, yaml);
    assert!(refused.starts_with("t.yaml: pose t-02 brings the TCP to ") && refused.contains("`post`"), "{refused}");
}

#[test]
fn the_way_home_is_planned_like_every_other() {
    let mut cell = sim();
    let yaml = format!("  - {{pattern: views, poses: [{{view: {CENTRE}}}]}}\n");
    let plan = plan_of(&cell, &yaml).unwrap();
    let home = plan.home.unwrap();
    let MoveTarget::Joint { joints_rad, speed_rad_s, .. } = home.target else { panic!("{home:?}") };
    assert_eq!(joints_rad, cell.robot.home_joints_rad);
    assert!(speed_rad_s > 0.0 && speed_rad_s <= cell.robot.limits.joint_speed_rad_s);
    let there = &plan.poses[0];
    assert!(home.move_s > 0.0 && plan.duration_s > there.move_s + home.move_s, "{plan:?}");

    let refused = |cell: &Cell| plan_of(cell, &yaml).unwrap_err().problems;
    let home_tcp_m = (Arm::ur5e().forward(&cell.robot.home_joints_rad) * cell.robot.tcp_offset).translation_m();
    let around = |by: f64| home_tcp_m.map(|v| v + by);
    cell.robot.keep_out.push(KeepOut { name: "post".into(), min_m: around(-0.01), max_m: around(0.01) });
    let [problem] = refused(&cell).try_into().unwrap();
    assert_eq!((problem.file.as_str(), problem.pose.as_str()), ("sim", "home"));
    assert!(problem.to_string().contains("inside the keep-out box `post`"), "{problem}");
    cell.robot.keep_out.clear();
    cell.robot.return_home = false;
    let stay = plan_of(&cell, &yaml).unwrap();
    assert!(stay.home.is_none() && stay.duration_s < plan.duration_s);
}

#[test]
fn a_move_at_run_time_keeps_caps_and_boxes() {
    let mut cell = sim();
    let (arm, home) = (Arm::ur5e(), cell.robot.home_joints_rad);
    let from: Joints = std::array::from_fn(|i| home[i] + if i == 0 { 0.2 } else { 0.05 });
    let (full, full_s) = JointMoves::of(&cell, &arm).between(&from, &home, 1.0).unwrap();
    let MoveTarget::Joint { joints_rad, speed_rad_s, acceleration_rad_s2 } = full else { panic!("{full:?}") };
    assert_eq!(joints_rad, home);
    // The TCP is 0.5 m from the base axis: 0.25 m/s are about 0.5 rad/s.
    assert!((0.3..0.6).contains(&speed_rad_s) && acceleration_rad_s2 <= 1.4, "{full:?}");
    for (factor, share) in [(0.25, 0.25), (4.0, 1.0), (-1.0, 0.01), (f64::NAN, 0.01)] {
        let (slow, slow_s) = JointMoves::of(&cell, &arm).between(&from, &home, factor).unwrap();
        let MoveTarget::Joint { speed_rad_s: found, .. } = slow else { panic!("{slow:?}") };
        assert!((found - share * speed_rad_s).abs() < 1e-12 && slow_s >= full_s, "{factor}: {slow:?} {slow_s} s");
    }
    let middle = std::array::from_fn(|i| 0.5 * (from[i] + home[i]));
    let at_m = (arm.forward(&middle) * cell.robot.tcp_offset).translation_m();
    let sheet = KeepOut { name: "sheet".into(), min_m: at_m, max_m: at_m.map(|v| v + 1e-5) };
    cell.robot.keep_out.push(sheet);
    let refused = JointMoves::of(&cell, &arm).between(&from, &home, 1.0).unwrap_err();
    assert!(matches!(&refused, Refusal::KeepOut { name, .. } if name == "sheet"), "{refused:?}");
    cell.robot.keep_out.clear();
    assert!(JointMoves::of(&cell, &arm).between(&[f64::NAN; 6], &home, 1.0).is_err());
    let far = [7.0, home[1], home[2], home[3], home[4], home[5]];
    let refused = JointMoves::of(&cell, &arm).between(&far, &home, 1.0).unwrap_err();
    assert!(matches!(&refused, Refusal::JointLimit { joint, .. } if joint == "shoulder_pan_joint"), "{refused:?}");
}

#[test]
fn moves_keep_joint_and_tcp_caps() {
    let cell = sim();
    let plan = expand(&cell, &trajectories(&cell)).unwrap();
    let arm = Arm::ur5e();
    let mut from = cell.robot.home_joints_rad;
    for pose in &plan.poses {
        if let MoveTarget::Joint { joints_rad, speed_rad_s, .. } = pose.target {
            let limit = cell.robot.limits.joint_speed_rad_s;
            assert!(speed_rad_s > 0.0 && speed_rad_s <= limit, "{pose:?}");
            let turn_rad = reach::distance_rad(&from, &joints_rad);
            for i in 0..50 {
                let at = |i: u32| {
                    let fraction = f64::from(i) / 50.0;
                    let q = std::array::from_fn(|k| from[k] + fraction * (joints_rad[k] - from[k]));
                    reach::base_from_tcp(&cell, &arm, &q)
                };
                let speed_m_s = at(i).distance_to_m(&at(i + 1)) * 50.0 * speed_rad_s / turn_rad.max(1e-9);
                assert!(speed_m_s <= cell.robot.limits.tcp_speed_m_s * 1.02, "{}: {speed_m_s} m/s", pose.id);
            }
        }
        from = pose.joints_rad;
    }
}

/// Number of poses at which a camera should see every corner, for each purpose.
fn full_views(cell: &Cell, plan: &Plan, kind: PoseKind) -> [usize; 2] {
    Camera::BOTH.map(|camera| {
        let full = |p: &&PlannedPose| p.corners_in_view.contains(&(camera, cell.board.corner_count()));
        plan.poses.iter().filter(|p| p.kind == kind).filter(full).count()
    })
}

#[test]
fn the_shipped_cell_can_be_visited() {
    let cell = sim();
    let plan = expand(&cell, &trajectories(&cell)).unwrap_or_else(|e| panic!("{e}"));
    let count = |kind| plan.poses.iter().filter(|p| p.kind == kind).count();
    assert_eq!([PoseKind::Intrinsics, PoseKind::HandEye, PoseKind::Distance].map(count), [39, 22, 12]);
    assert_eq!(full_views(&cell, &plan, PoseKind::Intrinsics), [39, 36]);
    assert_eq!(full_views(&cell, &plan, PoseKind::HandEye), [22, 22]);
    assert_eq!(full_views(&cell, &plan, PoseKind::Distance), [12, 12]);
    let truths: Vec<_> = plan.poses.iter().filter_map(|p| p.pair.as_ref()).map(|p| (p.truth_m * 1e3).round()).collect();
    assert_eq!(truths, [40.0, 40.0, 30.0, 30.0, 50.0, 50.0, 40.0, 40.0, 20.0, 20.0, 60.0, 60.0]);
    assert!((60.0..300.0).contains(&plan.duration_s), "{} s", plan.duration_s);
    // No pose near a singularity: all keep a smallest singular value well above 0.
    let arm = Arm::ur5e();
    let worst = plan.poses.iter().map(|p| arm.jacobian(&p.joints_rad).singular_values().min()).fold(f64::MAX, f64::min);
    assert!(worst > 0.1, "{worst}");
}

#[test]
fn the_shipped_cell_can_be_visited_by_an_individual_arm() {
    let cell = sim();
    let arm = Arm::from_urdf(&Dh::individual().to_urdf("individual")).unwrap();
    let plan = expand_with(&cell, &arm, &trajectories(&cell)).unwrap_or_else(|e| panic!("{e}"));
    let nominal = expand(&cell, &trajectories(&cell)).unwrap();
    for (a, b) in plan.poses.iter().zip(&nominal.poses) {
        // Millimetres at the flange are milliradians at the joints; a wrong branch is more than a radian.
        assert!(reach::distance_rad(&a.joints_rad, &b.joints_rad) < 0.05, "{}: {a:?} {b:?}", a.id);
        assert!(a.base_from_tcp.distance_to_m(&b.base_from_tcp) < 1e-7);
    }
}

#[test]
fn the_checked_corner_is_where_the_cell_says() {
    let cell = sim();
    let crate::config::Mount::Target { tcp_from_target, .. } = cell.nominal.mount else { panic!("{cell:?}") };
    let corner_in_tcp = tcp_from_target * cell.board.corner(cell.checks.corner_id).unwrap();
    let distance_m = corner_in_tcp.distance_m(crate::geometry::Point::origin());
    assert!((distance_m - cell.checks.target_to_tcp_m.unwrap()).abs() < 1e-9, "{distance_m}");
}

#[test]
fn the_rig_runs_the_published_poses_as_they_were() {
    let cell = cell("sim-rig.yaml");
    let plan = expand(&cell, &trajectories(&cell)).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(full_views(&cell, &plan, PoseKind::Intrinsics), [39, 34]);
    // Captures 0, 20 and 38 of trajectory `ueye` of the published script.
    for (index, pose) in PUBLISHED {
        let known = Transform::from_pose_vector(pose);
        let found = plan.poses[index].base_from_tcp;
        assert!(found.distance_to_m(&known) < 1e-6, "{index}: {found:?} is not {known:?}");
        assert!(found.angle_to_rad(&known) < 1e-6, "{index}: {found:?} is not {known:?}");
    }
}

#[expect(clippy::approx_constant, reason = "the published script writes 3.142")]
const PUBLISHED: [(usize, [f64; 6]); 3] = [
    (0, [0.115, -0.409, 0.397, 0.0, 0.0, 3.142]),
    (20, [0.115, -0.409, 0.52475, 0.0, -0.5305, 3.142]),
    (38, [-0.044, -0.409, 0.27, 0.061, 0.462, 3.52]),
];
