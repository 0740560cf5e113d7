//! Sessions against an arm that moves for 0.5 s and a camera that needs 0.2 s.

mod camera_gone;
mod watch;

use super::super::route::{Stop, Ways};
use super::super::stillness::tests::{limits, still_sample};
use super::super::types::{Exposure, MoveTarget};
use super::*;
use crate::config::Interlock;

fn interlock() -> Interlock {
    Interlock { digital_input: 3, must_be: true, meaning: "cell released".into() }
}

fn expected() -> Expected {
    Expected {
        tcp_offset: [0.0; 6],
        payload_kg: 0.5,
        payload_cog_m: [0.0; 3],
        allow_reduced: false,
        start_joints_rad: [0.1; 6],
        start_within_rad: 0.2,
        model: Some("UR5".into()),
        serial: Some("20235500001".into()),
        controller_version: Some("5.12".into()),
        kinematics_checksum: None,
        speed_slider: [0.1, 1.0],
        interlocks: vec![interlock()],
        gripper_empty: Some(Interlock { digital_input: 5, must_be: false, meaning: "gripper empty".into() }),
        external: false,
    }
}

fn facts() -> RobotFacts {
    RobotFacts {
        controller_version: [5, 12, 4, 1101],
        model: Some("UR5".into()),
        serial: Some("20235500001".into()),
        remote_control: Some(true),
        kinematics: None,
        motion: "test".into(),
        script_sha256: "abc".into(),
    }
}

fn joint(joints_rad: [f64; 6]) -> MoveTarget {
    MoveTarget::Joint { joints_rad, speed_rad_s: 1.0, acceleration_rad_s2: 1.0 }
}

fn pose_joints(pose: usize) -> [f64; 6] {
    [0.1 + 0.3 * (pose + 1) as f64; 6]
}

fn session_with(poses: usize, expected: Expected, options: Options) -> Live {
    let stop = |i| Stop { target: joint(pose_joints(i)), joints_rad: pose_joints(i), move_s: 0.5 };
    let home = Stop { target: joint([0.1; 6]), joints_rad: [0.1; 6], move_s: 0.5 };
    let ways = Ways::new(|_, to, _| Ok((joint(*to), 0.5)));
    let route = Route { stops: (0..poses).map(stop).collect(), start_joints_rad: [0.1; 6], home: Some(home), ways };
    Live::new(route, limits(), expected, options, Some("production.urp".into()))
}

fn session(poses: usize) -> Live {
    session_with(poses, expected(), Options::default())
}

/// The arm, its program and the cameras.
struct Bench {
    at_s: f64,
    joints: [f64; 6],
    goal: [f64; 6],
    sequence: i32,
    moving_until: f64,
    playing: bool,
    due: Option<(f64, Captured)>,
    answers: Vec<Input>,
    display: Watched,
    /// The camera that fails at a pose.
    fails: fn(usize) -> Option<Camera>,
    commands: Vec<(f64, Command)>,
}

impl Bench {
    fn new() -> Self {
        Self {
            at_s: 0.0,
            joints: [0.1; 6],
            goal: [0.1; 6],
            sequence: 0,
            moving_until: 0.0,
            playing: false,
            due: None,
            answers: Vec::new(),
            display: Watched::Problem("nothing blinks".into()),
            fails: |_| None,
            commands: Vec::new(),
        }
    }

    fn sample(&mut self) -> RobotSample {
        let mut sample = still_sample();
        let moving = self.at_s < self.moving_until;
        if moving {
            sample.executor_state = ExecutorState::Moving;
            sample.target_joint_speeds_rad_s = [0.3; 6];
            let left = (self.moving_until - self.at_s) / 0.5;
            self.joints = std::array::from_fn(|i| self.joints[i] + (self.goal[i] - self.joints[i]) * (1.0 - left));
        } else {
            self.joints = self.goal;
        }
        (sample.joints_rad, sample.target_joints_rad) = (self.joints, self.joints);
        sample.controller_time_s = 100.0 + self.at_s;
        sample.digital_inputs = 1 << 3;
        sample.executor_sequence = if moving { self.sequence - 1 } else { self.sequence };
        sample.runtime_state = if self.playing { 2 } else { 1 };
        if !self.playing {
            sample.executor_state = ExecutorState::Absent;
        } else if self.sequence == 0 {
            sample.executor_state = ExecutorState::Idle;
        }
        sample
    }

    fn obey(&mut self, command: &Command) {
        match command {
            Command::Start => (self.playing, self.sequence) = (true, 0),
            Command::Finish { .. } => self.playing = false,
            Command::Move { target, .. } | Command::Travel { target, .. } => {
                let MoveTarget::Joint { joints_rad, .. } = target else { panic!("{target:?}") };
                (self.sequence, self.moving_until, self.goal) = (self.sequence + 1, self.at_s + 0.5, *joints_rad);
            }
            Command::Capture { pose, attempt } => {
                let exposures = vec![Exposure::whole(self.at_s + 0.02, self.at_s + 0.12)];
                let captured = Captured { pose: *pose, attempt: *attempt, exposures, event_bytes: 0, declared: None };
                self.due = Some((self.at_s + 0.2, captured));
            }
            Command::Stop { .. } => {
                (self.goal, self.moving_until, self.playing) = (self.joints, 0.0, false);
            }
            Command::Watch => self.answers.push(Input::Watched(self.display.clone())),
            Command::Confirm { .. } | Command::Wait { .. } | Command::Guide { .. } => {}
        }
    }

    /// Runs on for `seconds`, or until the session is done.
    fn walk(&mut self, live: &mut Live, seconds: f64, spoil: impl Fn(f64, &mut RobotSample)) {
        let end_s = self.at_s + seconds;
        while self.at_s < end_s && !live.is_done() {
            let mut sample = self.sample();
            spoil(self.at_s, &mut sample);
            let mut inputs = vec![Input::Robot(Box::new(sample))];
            if self.due.as_ref().is_some_and(|(when, _)| self.at_s >= *when) {
                let delivered = |captured: Captured| match (self.fails)(captured.pose) {
                    None => Input::Captured(captured),
                    camera => Input::CaptureFailed { pose: captured.pose, camera, why: "its cable is out".into() },
                };
                inputs.extend(self.due.take().map(|(_, captured)| delivered(captured)));
            }
            inputs.append(&mut self.answers);
            for input in inputs {
                self.give(live, &input);
            }
            self.at_s += 0.008;
        }
    }

    fn give(&mut self, live: &mut Live, input: &Input) {
        if let Some(command) = live.handle(Stamp::from_seconds(self.at_s), input) {
            self.obey(&command);
            self.commands.push((self.at_s, command));
        }
    }
}

/// A connected session, walked to its end.
fn walk(live: &mut Live, spoil: impl Fn(f64, &mut RobotSample)) -> Vec<(f64, Command)> {
    let mut bench = Bench::new();
    bench.give(live, &Input::Connected(Box::new(facts())));
    bench.walk(live, 32.0, spoil);
    bench.commands
}

fn captures(commands: &[(f64, Command)]) -> Vec<usize> {
    let pose = |(_, c): &(f64, Command)| if let Command::Capture { pose, .. } = c { Some(*pose) } else { None };
    commands.iter().filter_map(pose).collect()
}

#[test]
fn every_pose_is_moved_to_awaited_and_captured_and_the_arm_goes_home() {
    let mut live = session(3);
    let commands = walk(&mut live, |_, _| ());
    assert_eq!(commands[0].1, Command::Start);
    assert_eq!(captures(&commands), [0, 1, 2]);
    let (moved, captured) = (commands[1].0, commands[2].0);
    assert!(captured - moved >= 0.5 + limits().window_s, "{moved} {captured}");
    let [.., (_, home), (_, end)] = commands.as_slice() else { panic!("{commands:?}") };
    assert!(matches!(home, Command::Travel { why, .. } if why == "home"), "{home:?}");
    assert_eq!(*end, Command::Finish { load: Some("production.urp".into()) });
    let outcome = live.into_outcome();
    assert_eq!(outcome.end, End::Complete);
    assert!(outcome.poses.iter().all(|p| p.capture.is_some() && p.base_from_tcp.is_some()));
    assert!(outcome.poses[1].joints_rad.is_some_and(|q| (q[0] - pose_joints(1)[0]).abs() < 1e-12));
}

#[test]
fn no_motion_without_preflight() {
    type Spoil = fn(&mut RobotSample);
    let faults: [(&str, Spoil); 13] = [
        ("robot_mode", |s| s.robot_mode = 5),
        ("safety_mode", |s| s.safety_mode = 3),
        ("safety_mode", |s| s.safety_mode = 2),
        ("program", |s| s.runtime_state = 4),
        ("program", |s| s.runtime_state = 2),
        ("teach_button", |s| s.robot_status_bits = 7),
        ("tcp_offset", |s| s.tcp_offset[2] = 0.001),
        ("payload", |s| s.payload_kg = f64::NAN),
        ("speed_slider", |s| s.target_speed_fraction = 0.05),
        ("speed_slider", |s| s.target_speed_fraction = f64::NAN),
        ("interlock", |s| s.digital_inputs = 0),
        ("gripper_empty", |s| s.digital_inputs |= 1 << 5),
        ("booting", |s| s.controller_time_s = 12.0),
    ];
    for (id, spoil) in faults {
        let mut live = session(3);
        let commands = walk(&mut live, |_, s| spoil(s));
        assert!(commands.iter().all(|(_, c)| *c == Command::Finish { load: None }), "{id}: {commands:?}");
        let End::PreflightFailed(findings) = live.into_outcome().end else { panic!("{id} passed") };
        assert!(findings.iter().any(|f| f.id == id), "{id}: {findings:?}");
    }
}

#[test]
fn another_controller_is_refused() {
    type Spoil = fn(&mut RobotFacts, &mut Expected);
    let faults: [(&str, Spoil); 7] = [
        ("serial", |f, _| f.serial = Some("2".into())),
        ("serial", |f, _| f.serial = None),
        ("model", |f, _| f.model = Some("UR10".into())),
        ("controller_version", |f, _| f.controller_version = [5, 11, 0, 0]),
        ("controller_version", |f, e| (f.controller_version, e.controller_version) = ([3, 15, 0, 0], None)),
        ("remote_control", |f, _| f.remote_control = Some(false)),
        ("kinematics_checksum", |_, e| e.kinematics_checksum = Some("00".into())),
    ];
    for (id, spoil) in faults {
        let (mut facts, mut expected) = (facts(), expected());
        spoil(&mut facts, &mut expected);
        let mut live = session_with(1, expected, Options::default());
        let mut bench = Bench::new();
        bench.give(&mut live, &Input::Connected(Box::new(facts)));
        bench.walk(&mut live, 5.0, |_, _| ());
        let End::PreflightFailed(findings) = live.into_outcome().end else { panic!("{id} passed") };
        assert_eq!(findings.iter().map(|f| f.id.as_str()).collect::<Vec<_>>(), [id]);
    }
}

#[test]
fn a_far_start_needs_a_confirmation_and_is_driven_to_slowly() {
    for (answer, moved) in [(Input::Confirmed, true), (Input::Declined, false)] {
        let mut live = session(1);
        let mut bench = Bench::new();
        (bench.joints, bench.goal) = ([0.9; 6], [0.9; 6]);
        bench.give(&mut live, &Input::Connected(Box::new(facts())));
        bench.walk(&mut live, 1.0, |_, _| ());
        assert!(matches!(bench.commands.as_slice(), [(_, Command::Confirm { .. })]), "{:?}", bench.commands);
        bench.answers.push(answer);
        bench.walk(&mut live, 20.0, |_, _| ());
        let travels = |c: &Command| matches!(c, Command::Travel { why, .. } if why == "home");
        assert_eq!(bench.commands.iter().filter(|(_, c)| travels(c)).count(), if moved { 2 } else { 0 });
        let end = live.into_outcome().end;
        assert_eq!(matches!(end, End::Complete), moved, "{end:?}");
        assert_eq!(matches!(end, End::PreflightFailed(_)), !moved);
    }
}

#[test]
fn interlocks_are_watched_while_the_first_question_is_open() {
    let mut live = session_with(2, expected(), Options { confirm_each: true, ..Options::default() });
    let mut bench = Bench::new();
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    bench.walk(&mut live, 4.0, |at, s| s.digital_inputs = if (2.0..2.1).contains(&at) { 0 } else { s.digital_inputs });
    let End::PreflightFailed(findings) = live.into_outcome().end else { panic!("it was not seen") };
    assert!(findings[0].message.contains("cell released"), "{findings:?}");
}

#[test]
fn every_move_is_confirmed_where_that_is_wanted() {
    let mut live = session_with(2, expected(), Options { confirm_each: true, ..Options::default() });
    let mut bench = Bench::new();
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    for asked in 1..=3 {
        bench.walk(&mut live, 4.0, |_, _| ());
        let questions = bench.commands.iter().filter(|(_, c)| matches!(c, Command::Confirm { .. })).count();
        assert_eq!(questions, asked);
        bench.answers.push(Input::Confirmed);
    }
    bench.walk(&mut live, 4.0, |_, _| ());
    assert_eq!(live.into_outcome().end, End::Complete);
}

#[test]
fn what_may_not_happen_in_motion_needs_an_operator() {
    type Spoil = fn(&mut RobotSample);
    let faults: [(&str, Spoil); 6] = [
        ("PROTECTIVE_STOP", |s| s.safety_mode = 3),
        ("cell released", |s| s.digital_inputs = 0),
        ("PAUSED", |s| s.runtime_state = 4),
        ("speed slider", |s| s.target_speed_fraction = 0.01),
        ("POWER_OFF", |s| s.robot_mode = 3),
        ("teach button", |s| s.robot_status_bits |= 4),
    ];
    for (word, spoil) in faults {
        for at_s in [0.6, 1.1] {
            let mut live = session(3);
            let commands = walk(&mut live, |at, s| {
                if at > at_s {
                    spoil(s)
                }
            });
            assert!(matches!(commands.last(), Some((_, Command::Stop { .. }))), "{word}: {commands:?}");
            let End::OperatorNeeded(why) = live.into_outcome().end else { panic!("{word}") };
            assert!(why.contains(word), "{why}");
        }
    }
}

#[test]
fn a_program_that_does_not_start_is_a_failed_preflight() {
    let mut live = session(1);
    walk(&mut live, |_, s| (s.runtime_state, s.executor_state) = (1, ExecutorState::Absent));
    let End::PreflightFailed(findings) = live.into_outcome().end else { panic!("it started") };
    assert!(findings[0].id == "program" && findings[0].message.contains("did not start"), "{findings:?}");
}

#[test]
fn an_arm_that_ends_elsewhere_stops_the_session() {
    let mut live = session(1);
    walk(&mut live, |_, s| s.joints_rad[4] += if s.executor_sequence == 1 { 0.02 } else { 0.0 });
    let End::OperatorNeeded(why) = live.into_outcome().end else { panic!("no refusal") };
    assert!(why.contains("1.15 deg from where it was sent"), "{why}");
}

#[test]
fn a_shaken_exposure_is_repeated() {
    let mut live = session(1);
    let undisturbed = walk(&mut session(1), |_, _| ());
    let shake_at = undisturbed[2].0 + 0.06;
    let commands =
        walk(&mut live, |at, s| s.joint_speeds_rad_s[2] = if (at - shake_at).abs() < 0.005 { 0.02 } else { 0.0 });
    assert_eq!(captures(&commands), [0, 0], "{commands:?}");
    let outcome = live.into_outcome();
    assert_eq!(outcome.poses[0].capture, Some(1));
    assert_eq!(outcome.captures.len(), 2);
}

#[test]
fn an_arm_that_never_rests_is_reported_not_photographed() {
    let mut live = session(1);
    let commands = walk(&mut live, |at, s| s.joint_speeds_rad_s[0] = if at > 0.3 { 0.02 } else { 0.0 });
    assert!(captures(&commands).is_empty());
    let End::OperatorNeeded(why) = live.into_outcome().end else { panic!("no refusal") };
    assert!(why.contains("does not come to rest"), "{why}");
}

#[test]
fn an_exposure_that_began_too_early_is_discarded() {
    let mut live = session(1);
    let mut bench = Bench::new();
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    bench.walk(&mut live, 1.15, |_, _| ());
    let (_, captured) = bench.due.as_mut().expect("a capture is under way");
    captured.exposures[0].start_s -= 0.5;
    bench.walk(&mut live, 10.0, |_, _| ());
    assert_eq!(captures(&bench.commands), [0, 0]);
}

#[test]
fn a_resumed_session_drives_back_and_visits_only_what_is_missing() {
    let mut live = session(4);
    let mut bench = Bench::new();
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    // Between the second and the third pose.
    bench.walk(&mut live, 2.45, |_, _| ());
    assert_eq!(captures(&bench.commands), [0, 1]);
    bench.give(&mut live, &Input::RobotLost { why: "network".into() });
    assert!(live.is_done() && live.missing() == 2);
    let stopped_at = bench.joints[0];
    assert!(stopped_at > pose_joints(1)[0] + 0.02 && stopped_at < pose_joints(2)[0], "{stopped_at}");
    (bench.goal, bench.moving_until, bench.playing) = (bench.joints, 0.0, false);
    bench.commands.clear();
    bench.give(&mut live, &Input::Resumed);
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    bench.walk(&mut live, 20.0, |_, _| ());
    assert_eq!(captures(&bench.commands), [2, 3]);
    let Command::Travel { target: MoveTarget::Joint { joints_rad, .. }, .. } = &bench.commands[1].1 else {
        panic!("{:?}", bench.commands)
    };
    assert!((joints_rad[0] - pose_joints(1)[0]).abs() < 1e-9, "back along the way to the last pose");
    let outcome = live.into_outcome();
    assert_eq!(outcome.end, End::Complete);
    assert!(outcome.poses.iter().all(|p| p.capture.is_some()));
}

#[test]
fn a_far_start_that_never_reached_home_is_asked_for_again() {
    // Lost before the approach begins, and in the middle of it.
    for seconds in [0.3, 0.36] {
        let mut live = session(2);
        let mut bench = Bench::new();
        (bench.joints, bench.goal) = ([0.9; 6], [0.9; 6]);
        bench.give(&mut live, &Input::Connected(Box::new(facts())));
        bench.walk(&mut live, 0.5, |_, _| ());
        bench.answers.push(Input::Confirmed);
        bench.walk(&mut live, seconds - 0.1, |_, _| ());
        bench.give(&mut live, &Input::RobotLost { why: "network".into() });
        assert!(captures(&bench.commands).is_empty());
        (bench.goal, bench.moving_until, bench.playing) = (bench.joints, 0.0, false);
        bench.commands.clear();
        bench.give(&mut live, &Input::Resumed);
        bench.give(&mut live, &Input::Connected(Box::new(facts())));
        bench.walk(&mut live, 5.0, |_, _| ());
        let [(_, Command::Confirm { .. })] = bench.commands.as_slice() else { panic!("{:?}", bench.commands) };
    }
}

#[test]
fn a_start_beside_home_takes_a_way_of_its_own() {
    let mut live = session(1);
    let mut bench = Bench::new();
    (bench.joints, bench.goal) = ([0.2; 6], [0.2; 6]);
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    let asked = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
    let heard = std::sync::Arc::clone(&asked);
    live.route.ways = Ways::new(move |from, to, _| {
        heard.lock().unwrap().push((*from, *to));
        Ok((joint(*to), 0.5))
    });
    bench.walk(&mut live, 10.0, |_, _| ());
    assert_eq!(live.into_outcome().end, End::Complete);
    assert!(asked.lock().unwrap().contains(&([0.2; 6], pose_joints(0))), "the way from where the arm really was");
}

#[test]
fn a_resumed_session_refuses_another_robot_and_an_arm_off_its_way() {
    let stopped = || {
        let mut live = session(3);
        let mut bench = Bench::new();
        bench.give(&mut live, &Input::Connected(Box::new(facts())));
        bench.walk(&mut live, 2.0, |_, _| ());
        bench.give(&mut live, &Input::RobotLost { why: "network".into() });
        (bench.goal, bench.moving_until, bench.playing) = (bench.joints, 0.0, false);
        bench.give(&mut live, &Input::Resumed);
        (live, bench)
    };
    let (mut live, mut bench) = stopped();
    bench.give(&mut live, &Input::Connected(Box::new(RobotFacts { script_sha256: "def".into(), ..facts() })));
    bench.walk(&mut live, 5.0, |_, _| ());
    let End::PreflightFailed(findings) = live.into_outcome().end else { panic!("it passed") };
    assert_eq!(findings[0].id, "changed");
    let (mut live, mut bench) = stopped();
    bench.goal[3] += 0.2;
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    bench.walk(&mut live, 5.0, |_, _| ());
    let End::PreflightFailed(findings) = live.into_outcome().end else { panic!("it passed") };
    assert_eq!(findings[0].id, "off_path");
    assert!(findings[0].message.contains("11.5 deg off the way"), "{findings:?}");
}

#[test]
fn a_program_of_the_plant_moves_and_we_only_capture() {
    let expected = Expected { external: true, ..expected() };
    let mut live = session_with(2, expected, Options { patience_s: 60.0, ..Options::default() });
    let mut bench = Bench::new();
    bench.playing = true;
    let mut plant = facts();
    plant.remote_control = Some(false);
    bench.give(&mut live, &Input::Connected(Box::new(plant)));
    // It ends a little beside the planned pose.
    bench.walk(&mut live, 30.0, |_, s| {
        s.joints_rad[0] += 0.05;
        s.target_joints_rad[0] += 0.05;
    });
    assert_eq!(captures(&bench.commands), [0, 1]);
}
