//! What may be taken as a pose, from samples with known truth.

use super::super::stillness::tests::{limits, still_sample};
use super::*;
use std::f64::consts::PI;

const QUIET: Advice<'_> = Advice { is_clear: &|_| Ok(()), hint: &|_| None };
const WIDE: [[f64; 2]; 6] = [[-TAU, TAU]; 6];

fn teacher() -> Teacher {
    Teacher::new(limits(), WIDE, BTreeSet::new())
}

/// Samples at 125 Hz from `from_s` on.
fn feed(teacher: &mut Teacher, from_s: f64, count: usize, spoil: impl Fn(usize, &mut RobotSample)) {
    for i in 0..count {
        let mut sample = still_sample();
        // Freedrive: no script, and the target follows the hand.
        sample.executor_state = super::super::ExecutorState::Absent;
        sample.target_joints_rad = [9.0; 6];
        sample.target_joint_speeds_rad_s = [1.0; 6];
        spoil(i, &mut sample);
        teacher.sample(Stamp::from_seconds(from_s + i as f64 * 0.008), &sample);
    }
}

fn at(teacher: &mut Teacher, from_s: f64, pose: [f64; 6], joints_rad: Joints) {
    feed(teacher, from_s, 60, |_, s| (s.tcp_pose, s.joints_rad) = (pose, joints_rad));
}

#[test]
fn the_light_goes_from_moving_over_settling_to_still() {
    let mut teacher = teacher();
    assert!(matches!(teacher.light(), Light::Moving { .. }));
    feed(&mut teacher, 0.0, 10, |_, s| s.joint_speeds_rad_s[2] = 0.02);
    assert_eq!(teacher.light().to_string(), "moving: joint 3 turns at 1.15 deg/s");
    feed(&mut teacher, 0.08, 26, |_, _| ());
    let shown = teacher.light().to_string();
    assert_eq!(shown, "settling 0.20 of 0.30 s, before that joint 3 turns at 1.15 deg/s");
    feed(&mut teacher, 0.08 + 26.0 * 0.008, 12, |_, _| ());
    assert_eq!(teacher.light(), Light::Still);
    assert!(teacher.window.len() <= 40, "{} samples are kept", teacher.window.len());
}

#[test]
fn what_is_still_is_what_a_session_calls_still() {
    let mut seed = 11u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (seed >> 33) as f64 / (1u64 << 31) as f64
    };
    let (mut still, mut all) = (0, 0);
    for _ in 0..60 {
        let (mut teacher, mut history, mut at_s) = (teacher(), History::default(), 1.0);
        let quick = 0.02 * random();
        for _ in 0..150 {
            at_s += if random() < 0.004 { 0.11 } else { 0.004 + 0.01 * random() };
            let mut sample = still_sample();
            sample.joints_rad[4] += 0.9e-4 * random() + if random() < 0.005 { 1e-4 } else { 0.0 };
            match random() {
                r if r < quick => sample.joint_speeds_rad_s[1] = -0.006,
                r if r < 1.2 * quick => sample.tcp_speed[1] = 0.0011,
                r if r < 1.4 * quick => sample.tcp_speed[5] = f64::NAN,
                r if r < 1.6 * quick => sample.joints_rad[0] = f64::NAN,
                _ => {}
            }
            let at = Stamp::from_seconds(at_s);
            sample.target_joints_rad = sample.joints_rad;
            history.push(at, &sample, 1.0);
            teacher.sample(at, &sample);
            assert_eq!(teacher.light() == Light::Still, history.is_still(&limits()), "{:?}", teacher.light());
            (still, all) = (still + usize::from(teacher.light() == Light::Still), all + 1);
        }
    }
    assert!(still > all / 10 && still < all * 9 / 10, "{still} of {all} says nothing");
}

#[test]
fn drift_and_a_new_tcp_break_the_window() {
    let mut drifting = teacher();
    feed(&mut drifting, 0.0, 60, |i, s| s.joints_rad[5] += 4e-6 * i as f64);
    let error = drifting.take(None, QUIET).unwrap_err();
    assert!(error.to_string().contains("joint 6 drifted by 0.00"), "{error}");
    let mut retooled = teacher();
    feed(&mut retooled, 0.0, 60, |i, s| s.tcp_offset[2] = if i < 50 { 0.04 } else { 0.05 });
    assert!(retooled.light().to_string().contains("the active TCP was another"), "{}", retooled.light());
}

#[test]
fn a_pose_is_the_mean_of_the_window_also_at_half_turns() {
    let mut teacher = teacher();
    feed(&mut teacher, 0.0, 100, |i, s| {
        let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
        s.joints_rad[0] = 3.0 + sign * 2e-5;
        // The rotation vector flips its sign near pi.
        s.tcp_pose = [0.4 + sign * 1e-5, 0.0, 0.2, 0.0, sign * (PI - 1e-6), 0.0];
    });
    let taken = teacher.take(Some("down"), QUIET).unwrap();
    assert!((taken.pose.joints_rad[0] - 3.0).abs() < 1e-6, "{taken:?}");
    let truth = Transform::from_pose_vector([0.4, 0.0, 0.2, 0.0, PI, 0.0]);
    let found = taken.pose.base_from_tcp;
    assert!(found.angle_to_rad(&truth) < 1e-6 && found.distance_to_m(&truth) < 1e-6, "{found:?}");
}

#[test]
fn names_are_given_or_numbered_and_unique() {
    let mut teacher = Teacher::new(limits(), WIDE, ["p02".to_owned()].into());
    feed(&mut teacher, 0.0, 60, |_, _| ());
    let mut take = |name: Option<&str>| teacher.take(name, QUIET).map(|t| t.pose.name);
    assert_eq!(take(None).unwrap(), "p01");
    assert_eq!(take(None).unwrap(), "p03", "p02 is in the file");
    assert_eq!(take(Some("p04")).unwrap(), "p04");
    assert_eq!(take(None).unwrap(), "p05");
    assert!(matches!(take(Some("p02")), Err(TeachError::Doubled { .. })));
    assert!(matches!(take(Some("p01")), Err(TeachError::Doubled { .. })));
    assert!(matches!(take(Some("a b")), Err(TeachError::Name { .. })));
    assert_eq!(teacher.undo().map(|p| p.name).as_deref(), Some("p05"));
    assert_eq!(teacher.take(None, QUIET).unwrap().pose.name, "p05");
    assert_eq!(teacher.poses().len(), 4);
}

#[test]
fn what_speaks_against_a_pose_is_said() {
    let mut teacher = Teacher::new(limits(), [[-1.0, 1.0]; 6], BTreeSet::new());
    let down = [0.4, 0.0, 0.2, 0.0, PI, 0.0];
    at(&mut teacher, 0.0, down, [0.1; 6]);
    assert_eq!(teacher.take(None, QUIET).unwrap().warnings, Vec::<String>::new());
    let (mut near, mut turned) = (down, down);
    (near[0], turned[4]) = (0.404, PI - 0.03);
    at(&mut teacher, 1.0, near, [0.1, 1.1, 0.1, 0.1, 0.1, 0.1]);
    let boxed = Advice { is_clear: &|_| Err("the TCP is in the box".into()), hint: &|p| Some(p.len().to_string()) };
    let taken = teacher.take(Some("near"), boxed).unwrap();
    assert_eq!(taken.warnings.len(), 3, "{taken:?}");
    assert!(taken.warnings[0].contains("4.00 mm and 0.00 deg from pose `p01`"), "{taken:?}");
    assert!(taken.warnings[1].contains("joint 2 is at 63.0 deg, outside the -57.3 to 57.3"), "{taken:?}");
    assert_eq!((taken.warnings[2].as_str(), taken.hint.as_deref()), ("the TCP is in the box", Some("2")));
    at(&mut teacher, 2.0, turned, [0.1; 6]);
    assert_eq!(teacher.take(None, QUIET).unwrap().warnings, Vec::<String>::new(), "1.7 deg away");
}

#[test]
fn a_changed_tcp_a_dead_arm_and_a_joint_beyond_a_turn_are_refused() {
    let mut teacher = teacher();
    feed(&mut teacher, 0.0, 60, |_, _| ());
    teacher.take(None, QUIET).unwrap();
    feed(&mut teacher, 1.0, 60, |_, s| s.tcp_offset[0] = 0.002);
    let error = teacher.take(None, QUIET).unwrap_err();
    assert_eq!(error, TeachError::TcpChanged { apart_mm: 2.0, apart_deg: 0.0 });
    teacher.undo();
    teacher.take(None, QUIET).unwrap();
    feed(&mut teacher, 2.0, 60, |_, s| s.robot_mode = 3);
    assert!(teacher.take(None, QUIET).unwrap_err().to_string().contains("3 (POWER_OFF)"));
    feed(&mut teacher, 3.0, 60, |_, s| (s.joints_rad[5], s.tcp_offset[0]) = (6.3, 0.002));
    assert!(matches!(teacher.take(None, QUIET), Err(TeachError::BeyondTurn { joint: 6, .. })));
    assert_eq!(teacher.poses().len(), 1);
}
