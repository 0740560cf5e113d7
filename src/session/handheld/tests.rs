//! Looks at a board that is moved, held still and nudged.

use super::*;
use crate::board::Corner;
use crate::session::Exposure;

const SIZE: [u32; 2] = [1280, 720];

fn view(at: [f64; 2], scale: f64) -> View {
    let px = |id: u32| {
        [at[0] + scale * f64::from(id % 6), at[1] + scale * (1.0 + 0.02 * f64::from(id % 6)) * f64::from(id / 6)]
    };
    View::new((0..24).map(|id| Corner::at(id, px(id))).collect())
}

fn look(at: [f64; 2], scale: f64) -> Input {
    let views = [Camera::Rgb, Camera::Event].map(|camera| (camera, view(at, scale)));
    Input::Looked(Look { views: views.into() })
}

fn machine(poses: usize) -> Handheld {
    let sizes = [(Camera::Rgb, SIZE), (Camera::Event, SIZE)].into();
    Handheld::new(HandheldRules { poses, motion_px: 1.0, hold_s: 0.4, min_corners: 6, sizes })
}

/// Feeds looks at 5 Hz from `at_s` on; the first capture that is asked for, and when.
fn feed(machine: &mut Handheld, at_s: &mut f64, looks: &[Input]) -> Option<(Command, f64)> {
    for input in looks {
        *at_s += 0.2;
        if let Some(command @ Command::Capture { .. }) = machine.handle(Stamp::from_seconds(*at_s), input) {
            return Some((command, *at_s));
        }
    }
    None
}

fn captured(pose: usize, attempt: u32, at_s: f64) -> Input {
    let exposures = vec![Exposure::whole(at_s, at_s + 0.1)];
    Input::Captured(Captured { pose, attempt, exposures, event_bytes: 0, declared: None })
}

#[test]
fn a_capture_is_taken_when_both_cameras_see_it_still_for_long_enough() {
    let (mut machine, mut at_s) = (machine(5), 0.0);
    assert!(matches!(machine.start(), Some(Command::Guide { .. })));
    let moving: Vec<_> = (0..20).map(|i| look([300.0 + 5.0 * f64::from(i), 200.0], 40.0)).collect();
    assert!(feed(&mut machine, &mut at_s, &moving).is_none(), "it moves by 5 px from look to look");
    let held: Vec<_> = (0..10).map(|i| look([400.0 + 0.3 * f64::from(i % 2), 200.0], 40.0)).collect();
    let began_s = at_s;
    let (command, when_s) = feed(&mut machine, &mut at_s, &held).unwrap();
    assert_eq!(command, Command::Capture { pose: 0, attempt: 0 });
    // The first look is compared with the last one in motion; still from the second on, for 0.4 s.
    assert!((when_s - began_s - 0.8).abs() < 1e-9, "{}", when_s - began_s);
}

#[test]
fn one_camera_that_sees_motion_or_nothing_is_enough_to_wait() {
    let (mut machine, mut at_s) = (machine(5), 0.0);
    let one_moves = |i: i32| {
        let event = view([400.0 + 3.0 * f64::from(i), 200.0], 40.0);
        let views = [(Camera::Rgb, view([400.0, 200.0], 40.0)), (Camera::Event, event)];
        Input::Looked(Look { views: views.into() })
    };
    let moving: Vec<_> = (0..20).map(one_moves).collect();
    assert!(feed(&mut machine, &mut at_s, &moving).is_none());
    let blind = Input::Looked(Look { views: [(Camera::Rgb, view([400.0, 200.0], 40.0))].into() });
    let Some(Command::Guide { advice }) = machine.handle(Stamp::from_seconds(10.0), &blind) else { panic!() };
    assert!(advice.contains("the event camera does not see it"), "{advice}");
    assert!(feed(&mut machine, &mut at_s, &vec![blind; 20]).is_none());
}

#[test]
fn a_nudge_during_the_exposure_repeats_the_capture() {
    let (mut machine, mut at_s) = (machine(5), 0.0);
    let held = vec![look([400.0, 200.0], 40.0); 10];
    let (_, when_s) = feed(&mut machine, &mut at_s, &held).unwrap();
    assert_eq!(machine.handle(Stamp::from_seconds(when_s + 0.2), &captured(0, 0, when_s)), None);
    let nudged = look([404.0, 200.0], 40.0);
    let after = machine.handle(Stamp::from_seconds(when_s + 0.4), &nudged);
    assert_eq!(after, Some(Command::Wait { pose: 0, attempt: 1 }));
    assert_eq!(machine.taken(), 0);
    at_s = when_s + 1.0;
    let (command, _) = feed(&mut machine, &mut at_s, &vec![nudged; 10]).unwrap();
    assert_eq!(command, Command::Capture { pose: 0, attempt: 1 });
}

#[test]
fn the_same_place_counts_once_and_the_session_ends_when_all_are_there() {
    let (mut machine, mut at_s) = (machine(5), 0.0);
    let mut last = None;
    for pose in 0..5_usize {
        let held = vec![look([200.0 + 90.0 * pose as f64, 150.0], 40.0); 10];
        let (command, when_s) = feed(&mut machine, &mut at_s, &held).unwrap();
        assert_eq!(command, Command::Capture { pose, attempt: 0 });
        machine.handle(Stamp::from_seconds(when_s + 0.2), &captured(pose, 0, when_s));
        at_s = when_s + 0.4;
        last = machine.handle(Stamp::from_seconds(at_s), &held[0]);
        assert!(pose == 4 || feed(&mut machine, &mut at_s, &held).is_none(), "the same place again");
    }
    assert_eq!(last, Some(Command::Finish { load: None }));
    assert!(machine.is_done());
    let outcome = machine.into_outcome();
    assert_eq!(outcome.end, End::Complete);
    let captures: Vec<_> = outcome.poses.iter().map(|p| p.capture).collect();
    assert_eq!(captures, [Some(0), Some(1), Some(2), Some(3), Some(4)]);
}

#[test]
fn corners_that_are_not_numbers_are_never_still() {
    let (mut machine, mut at_s) = (machine(5), 0.0);
    let odd = vec![look([f64::NAN, 200.0], 40.0); 20];
    assert!(feed(&mut machine, &mut at_s, &odd).is_none());
}

#[test]
fn advice_asks_for_what_is_missing() {
    let mut coverage = Coverage::default();
    assert!(coverage.advice(0, 30).contains("middle"));
    for i in 0..8 {
        coverage.add(Place::of(&view([100.0 + 20.0 * f64::from(i), 100.0], 40.0), SIZE).unwrap());
    }
    let advice = coverage.advice(8, 30);
    assert!(advice.contains("tilt") && advice.contains("22 to go"), "{advice}");
}
