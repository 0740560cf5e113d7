//! A camera that is gone ends the session before every pose was tried in vain.

use super::*;
use crate::geometry::Camera::{Event, Rgb};

fn walked(live: &mut Live, fails: fn(usize) -> Option<Camera>) -> Vec<(f64, Command)> {
    let mut bench = Bench { fails, ..Bench::new() };
    bench.give(live, &Input::Connected(Box::new(facts())));
    bench.walk(live, 60.0, |_, _| ());
    assert!(live.is_done());
    bench.commands
}

#[test]
fn a_camera_that_is_gone_stops_the_arm_after_three_poses() {
    let mut live = session(6);
    let commands = walked(&mut live, |pose| (pose >= 1).then_some(Rgb));
    assert_eq!(captures(&commands), [0, 1, 1, 1, 2, 2, 2, 3, 3, 3]);
    let (_, Command::Stop { why }) = commands.last().unwrap() else { panic!("{commands:?}") };
    assert_eq!(why, "the rgb camera failed at 3 poses in a row, at the last one: its cable is out");
    let Outcome { end, poses, .. } = live.into_outcome();
    assert_eq!(end, End::OperatorNeeded(why.clone()));
    assert!(poses[0].capture.is_some(), "what was captured is kept");
    let skipped: Vec<_> = poses.iter().filter_map(|p| p.skipped.as_deref()).collect();
    let failed = "its cable is out, 3 times";
    assert_eq!(skipped, [failed, failed, failed, "not reached", "not reached"]);
}

#[test]
fn only_the_same_camera_pose_after_pose_counts() {
    let fine: [fn(usize) -> Option<Camera>; 3] = [
        // A capture between them.
        |pose| (pose != 2 && pose != 5).then_some(Event),
        // One camera, then the other.
        |pose| Some(if pose / 2 % 2 == 0 { Event } else { Rgb }),
        // Two at the end.
        |pose| (pose >= 6).then_some(Rgb),
    ];
    for fails in fine {
        let mut live = session(8);
        walked(&mut live, fails);
        assert_eq!(live.into_outcome().end, End::Complete);
    }
    for failed_poses in [1, 5] {
        let mut live = session_with(8, expected(), Options { failed_poses, ..Options::default() });
        let commands = walked(&mut live, |_| Some(Event));
        assert_eq!(captures(&commands).len(), 3 * failed_poses as usize, "{commands:?}");
    }
}

#[test]
fn a_camera_that_failed_is_tried_anew_after_a_resume() {
    let mut live = session(4);
    let mut bench = Bench { fails: |_| Some(Rgb), ..Bench::new() };
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    bench.walk(&mut live, 60.0, |_, _| ());
    assert_eq!(live.missing(), 4);
    bench.fails = |_| None;
    bench.give(&mut live, &Input::Resumed);
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    let before = bench.commands.len();
    bench.walk(&mut live, 60.0, |_, _| ());
    assert_eq!(captures(&bench.commands[before..]), [0, 1, 2, 3]);
    assert_eq!(live.into_outcome().end, End::Complete);
}

#[test]
fn a_recording_that_does_not_name_the_camera_goes_on_as_it_did() {
    let old: Input = serde_json::from_str(r#"{"input": "capture_failed", "pose": 1, "why": "gone"}"#).unwrap();
    assert_eq!(old, Input::CaptureFailed { pose: 1, camera: None, why: "gone".into() });
    let mut failing = Failing::default();
    assert!((0..50).all(|_| failing.gave_up(None, "gone", 3).is_none()));
}
