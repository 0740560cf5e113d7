//! Paths beside, through and past boxes, with known distances and against dense sampling.

use super::*;
use crate::config::{ToolShape, parse_cell};
use crate::geometry::kinematics::Dh;

const CELL: &str = "name: t
carried: target
robot:
  driver: sim
  model: ur5e
  tcp_offset: {xyz_mm: [0, 0, 40], rotvec_deg: [0, 0, 0]}
  payload_kg: 0.45
  home_joints_deg: [92, -62, 128, -66, 92, 0]
board: {dictionary: DICT_4X4_50, squares_x: 7, squares_y: 5, square_mm: 8.8, marker_mm: 7.04}
display: {alpha: 0.6, cycle_hz: 15}
event: {driver: sim, width: 1280, height: 720, lens: 12 mm, focal_length_mm: 12, pixel_pitch_um: 4.86}
nominal:
  base_from_camera: {xyz_m: [0.125, -0.563, 0.382], rotvec_deg: [180, 0, 0]}
  tcp_from_target: {xyz_mm: [-35.2, 9, 49.6], rotvec_deg: [90, 0, 0]}
trajectories:
  - {file: a.yaml, purpose: hand_eye}
";

fn cell() -> Cell {
    parse_cell(CELL, "t.yaml").unwrap_or_else(|e| panic!("{e}"))
}

fn with_box(min_m: [f64; 3], max_m: [f64; 3]) -> Cell {
    let mut cell = cell();
    cell.robot.keep_out = vec![KeepOut { name: "box".into(), min_m, max_m }];
    cell
}

/// The nominal arm, a calibrated one, and one whose shape is not known.
fn arms() -> [Arm; 3] {
    let mut longer = Dh::UR5E;
    longer.a_m[1] = -0.5;
    [
        Arm::ur5e(),
        Arm::from_urdf(&Dh::individual().to_urdf("i")).unwrap(),
        Arm::from_urdf(&longer.to_urdf("l")).unwrap(),
    ]
}

/// Numbers in 0 to 1, the same every time.
fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn near_home(next: &mut impl FnMut() -> f64, by_rad: f64) -> Joints {
    cell().robot.home_joints_rad.map(|q| q + by_rad * (2.0 * next() - 1.0))
}

fn smallest_gap_m(clearance: &Clearance, way: &[Joints]) -> f64 {
    let gaps = way.iter().flat_map(|q| clearance.gaps(q)).map(|gap| gap.gap_m);
    gaps.fold(f64::MAX, f64::min)
}

#[test]
fn no_point_moves_farther_than_the_levers_say() {
    let mut next = numbers(3);
    for arm in arms() {
        let clearance = Clearance::of(&cell(), &arm);
        for _ in 0..200 {
            let from: Joints = std::array::from_fn(|_| 6.0 * next() - 3.0);
            let turns: Joints = std::array::from_fn(|_| if next() < 0.5 { 0.0 } else { 0.4 * next() - 0.2 });
            let to = std::array::from_fn(|i| from[i] + turns[i]);
            let (a, b) = (clearance.frames(&from), clearance.frames(&to));
            for (i, part) in clearance.parts.iter().enumerate() {
                let (a, b) = (clearance.capsule(i, &a), clearance.capsule(i, &b));
                let moved_m = a.from.distance_m(b.from).max(a.to.distance_m(b.to));
                assert!(moved_m <= part.moves_m(&turns.map(f64::abs)) + 1e-12, "{part:?}: {moved_m} m");
            }
        }
    }
}

#[test]
fn a_joint_path_is_refused_exactly_where_it_comes_near() {
    let mut next = numbers(11);
    for arm in arms() {
        let (mut hits, mut close, mut clear) = (0, 0, 0);
        for _ in 0..200 {
            let (from, to) = (near_home(&mut next, 0.6), near_home(&mut next, 0.6));
            let min_m = [0.8 * next() - 0.4, -0.9 * next(), next() - 0.3];
            let thickness = [0.3 * next(), 0.3 * next(), 1e-4];
            let mut cell = with_box(min_m, std::array::from_fn(|i| min_m[i] + thickness[i]));
            cell.robot.keep_out_margin_m = 0.02 * next();
            let clearance = Clearance::of(&cell, &arm);
            let at = |i: u32| std::array::from_fn(|k| from[k] + (to[k] - from[k]) * f64::from(i) / 150.0);
            let way: Vec<Joints> = (0..=150).map(at).collect();
            let room_m = smallest_gap_m(&clearance, &way) - cell.robot.keep_out_margin_m;
            let answer = clearance.joint_path(&from, &to);
            if room_m <= 0.0 {
                assert!(answer.is_err(), "{room_m}");
                hits += 1;
            } else if room_m > 0.001 {
                // Half a millimetre of doubt, and what sampling every few millimetres misses.
                let step_m = clearance.parts.iter().map(|p| p.moves_m(&[1.2 / 300.0; 6])).fold(0.0, f64::max);
                assert!(answer.is_ok() || room_m < step_m, "{room_m} {answer:?}");
                clear += 1;
                close += u32::from(room_m < 0.05);
            }
        }
        assert!(hits > 20 && clear > 30 && close > 8, "the cases are too kind: {hits} {clear} {close}");
    }
}

#[test]
fn a_sheet_thinner_than_any_step_is_not_passed() {
    // Half a turn of the base joint, through a sheet of a hundredth of a millimetre.
    let home = cell().robot.home_joints_rad;
    let (mut from, mut to) = (home, home);
    (from[0], to[0]) = (home[0] - 1.5, home[0] + 1.5);
    let cell = with_box([0.1, -0.9, -0.2], [0.100_01, -0.25, 0.9]);
    let clearance = Clearance::of(&cell, &Arm::ur5e());
    assert!(clearance.at(&from).is_ok() && clearance.at(&to).is_ok());
    let refused = clearance.joint_path(&from, &to).unwrap_err();
    assert!(matches!(&refused, Refusal::KeepOut { name, gap_m, .. } if name == "box" && *gap_m <= 0.0), "{refused:?}");
}

#[test]
fn a_straight_path_is_refused_where_it_comes_near() {
    let mut next = numbers(5);
    for arm in arms() {
        let (mut hits, mut clear) = (0, 0);
        for _ in 0..150 {
            let from = near_home(&mut next, 0.2);
            let start = arm.forward(&from) * cell().robot.tcp_offset;
            let mut pose = start.pose_vector();
            pose[0] += 0.2 * next() - 0.1;
            pose[2] += 0.2 * next() - 0.1;
            let end = Transform::from_pose_vector(pose);
            let min_m = [0.6 * next() - 0.3, -0.9 * next(), 0.8 * next() - 0.2];
            let cell = with_box(min_m, [min_m[0] + 0.1, min_m[1] + 1e-4, min_m[2] + 0.1]);
            let clearance = Clearance::of(&cell, &arm);
            let mut q = from;
            let at = |i: u32| {
                let there = start.interpolate(&end, f64::from(i) / 200.0) * cell.robot.tcp_offset.inverse();
                q = arm.inverse(&there, &q).unwrap();
                q
            };
            let way: Vec<Joints> = (0..=200).map(at).collect();
            let room_m = smallest_gap_m(&clearance, &way);
            let answer = clearance.linear_path(&from, pose);
            if room_m <= 0.0 {
                assert!(answer.is_err(), "{room_m}");
                hits += 1;
            } else if room_m > 0.003 {
                let reached = arm.forward(&answer.unwrap()) * cell.robot.tcp_offset;
                assert!(reached.distance_to_m(&end) < 1e-7, "{reached:?}");
                clear += 1;
            }
        }
        assert!(hits > 8 && clear > 20, "the cases are too kind: {hits} {clear}");
    }
}

#[test]
fn joints_bend_less_between_looks_than_is_allowed_for() {
    let mut next = numbers(8);
    let arm = Arm::ur5e();
    let tcp = cell().robot.tcp_offset;
    for _ in 0..40 {
        let from = near_home(&mut next, 0.3);
        let start = arm.forward(&from) * tcp;
        let mut pose = start.pose_vector();
        for value in &mut pose[..3] {
            *value += 0.15 * next() - 0.075;
        }
        let Ok(way) = way::linear(&arm, &tcp, &from, &Transform::from_pose_vector(pose)) else { continue };
        for ((i, q), bend) in way.windows(2).enumerate().zip(bends_rad(&way)) {
            let end = Transform::from_pose_vector(pose);
            let half_way = start.interpolate(&end, (i as f64 + 0.5) / (way.len() - 1) as f64);
            let middle = arm.inverse(&(half_way * tcp.inverse()), &q[0]).unwrap();
            for k in 0..6 {
                let off_rad = (middle[k] - 0.5 * (q[0][k] + q[1][k])).abs();
                assert!(off_rad <= bend[k] + 1e-6, "joint {k}: {off_rad} {}", bend[k]);
            }
        }
    }
}

#[test]
fn what_the_robot_stands_on_does_not_count() {
    let home = cell().robot.home_joints_rad;
    let pedestal = with_box([-0.15, -0.15, -1.0], [0.15, 0.15, 0.05]);
    assert_eq!(Clearance::of(&pedestal, &Arm::ur5e()).at(&home), Ok(()));
    // A table under the base, and a margin that the shoulder does not keep from it but the upper arm does.
    let mut table = with_box([-2.0, -2.0, -1.0], [2.0, 2.0, 0.0]);
    table.robot.keep_out_margin_m = 0.085;
    let upright = [0.0, -90.0, 0.0, -90.0, 0.0, 0.0].map(f64::to_radians);
    assert_eq!(Clearance::of(&table, &Arm::ur5e()).at(&upright), Ok(()));
    table.robot.keep_out_margin_m = 0.09;
    let refused = Clearance::of(&table, &Arm::ur5e()).at(&upright).unwrap_err();
    assert!(matches!(&refused, Refusal::KeepOut { part, .. } if part == "upper arm"), "{refused:?}");
    // A wall beside the base is something else: the shoulder turns into it.
    let wall = with_box([-0.2, -1.0, 0.0], [-0.1, 1.0, 0.25]);
    let clearance = Clearance::of(&wall, &Arm::ur5e());
    assert_eq!(clearance.at(&home), Ok(()));
    let turned = [home[0] + std::f64::consts::PI, home[1], home[2], home[3], home[4], home[5]];
    let refused = clearance.at(&turned).unwrap_err().to_string();
    assert!(
        refused.starts_with("brings the shoulder to ") && refused.contains("inside the keep-out box `box`"),
        "{refused}"
    );
}

#[test]
fn the_margin_is_kept_and_named() {
    let cell = cell();
    let home = cell.robot.home_joints_rad;
    let tcp_m = (Arm::ur5e().forward(&home) * cell.robot.tcp_offset).translation_m();
    // Below the board, which hangs under the TCP: nothing else is near.
    let mut below = with_box([tcp_m[0] - 0.01, tcp_m[1] - 0.5, -0.3], [tcp_m[0] + 0.01, tcp_m[1] + 0.5, -0.2]);
    let gap = Clearance::of(&below, &Arm::ur5e()).gaps(&home)[0].clone();
    below.robot.keep_out_margin_m = gap.gap_m - 1e-6;
    assert_eq!(Clearance::of(&below, &Arm::ur5e()).at(&home), Ok(()));
    below.robot.keep_out_margin_m = gap.gap_m + 1e-6;
    let refused = Clearance::of(&below, &Arm::ur5e()).at(&home).unwrap_err();
    let Refusal::KeepOut { part, at_m, .. } = &refused else { panic!("{refused}") };
    assert_eq!(part, &gap.part);
    assert!((at_m[2] - (-0.2 + gap.gap_m)).abs() < 1e-9, "{refused:?}");
    let said = format!(
        "{:.1} mm from the keep-out box `box`, where `keep_out_margin_mm` and 0.5 mm are kept",
        gap.gap_m * 1e3
    );
    assert!(refused.to_string().contains(&said), "{refused}");
}

#[test]
fn tool_and_cameras_count() {
    let home = cell().robot.home_joints_rad;
    for arm in arms() {
        let base_from_flange = arm.forward(&home);
        // 300 mm out of the flange: nothing but the tool.
        let tip = base_from_flange * Point::<Flange>::assume_frame([0.0, 0.0, 0.3]);
        let around = |by: f64| tip.xyz_m().map(|v| v + by);
        let mut cell = with_box(around(-0.001), around(0.001));
        assert_eq!(Clearance::of(&cell, &arm).at(&home), Ok(()));
        let gripper = ToolShape { name: "gripper".into(), from_m: [0.0; 3], to_m: [0.0, 0.0, 0.26], radius_m: 0.045 };
        cell.robot.tool = vec![gripper];
        let refused = Clearance::of(&cell, &arm).at(&home).unwrap_err();
        assert!(matches!(&refused, Refusal::KeepOut { part, .. } if part == "gripper"), "{refused:?}");
        cell.robot.tool.clear();
        let tcp_from_camera = Transform::from_parts([0.0, 0.045, 0.26], nalgebra::UnitQuaternion::identity());
        cell.nominal.mount = Mount::Cameras { tcp_from_camera, base_from_target: Transform::identity() };
        let refused = Clearance::of(&cell, &arm).at(&home).unwrap_err();
        assert!(matches!(&refused, Refusal::KeepOut { part, .. } if part == "event camera"), "{refused:?}");
    }
}

#[test]
fn rods_hold_the_display_and_its_bezel() {
    for size_m in [[0.0616, 0.044], [0.044, 0.0616], [0.3, 0.2], [0.01, 0.01]] {
        let rods = plate(size_m);
        let distance_m = |x: f64, y: f64, z: f64| {
            let to_rod = |[from, to]: &[[f64; 2]; 2]| {
                let on = [x.clamp(from[0], to[0]), y.clamp(from[1], to[1])];
                Vector3::new(x - on[0], y - on[1], z).norm()
            };
            rods.iter().map(to_rod).fold(f64::MAX, f64::min)
        };
        for i in 0..=60 {
            for k in 0..=60 {
                let across = |share: u32, size_m: f64| -BEZEL_M + (size_m + 2.0 * BEZEL_M) * f64::from(share) / 60.0;
                let (x, y) = (across(i, size_m[0]), across(k, size_m[1]));
                assert!(distance_m(x, y, 0.0) <= BEZEL_M + 1e-9, "{size_m:?}: {x} {y}");
                let on_board = (0.0..=size_m[0]).contains(&x) && (0.0..=size_m[1]).contains(&y);
                assert!(!on_board || distance_m(x, y, 0.86 * BEZEL_M) <= BEZEL_M + 1e-9, "{size_m:?}: {x} {y}");
            }
        }
    }
}

#[test]
fn joint_limits_and_numbers_are_looked_at() {
    let cell = cell();
    let home = cell.robot.home_joints_rad;
    let clearance = Clearance::of(&cell, &Arm::ur5e());
    let mut bent = home;
    bent[2] = 3.5;
    let is_limit =
        |r: Result<(), Refusal>| matches!(r, Err(Refusal::JointLimit { joint, .. }) if joint == "elbow_joint");
    assert!(is_limit(clearance.at(&bent)));
    assert!(is_limit(clearance.joint_path(&home, &bent)) && is_limit(clearance.joint_path(&bent, &home)));
    bent[2] = f64::NAN;
    assert!(is_limit(clearance.at(&bent)) && is_limit(clearance.joint_path(&home, &bent)));
    assert!(clearance.linear_path(&bent, [0.1, -0.5, 0.1, 0.0, 0.0, 0.0]).is_err());
    assert!(clearance.linear_path(&home, [f64::NAN; 6]).is_err());
    let out_of_reach = clearance.linear_path(&home, [0.1, -1.5, 0.1, 0.0, 0.0, 0.0]);
    assert!(matches!(out_of_reach, Err(Refusal::OutOfReach(_) | Refusal::NoStraightLine)), "{out_of_reach:?}");
    // A straight way that ends within the limits, and leaves them in between or at its end.
    let mut narrow = cell.clone();
    let pose = (Arm::ur5e().forward(&home) * cell.robot.tcp_offset).pose_vector();
    let up = [pose[0], pose[1], pose[2] + 0.1, pose[3], pose[4], pose[5]];
    let end = clearance.linear_path(&home, up).unwrap();
    let mut limits = [[-6.3, 6.3]; 6];
    limits[2] = [home[2].min(end[2]) + 0.01, 3.0];
    narrow.robot.limits.joints_rad = Some(limits);
    assert!(Clearance::of(&narrow, &Arm::ur5e()).linear_path(&home, up).is_err());
}
