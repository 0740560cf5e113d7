//! The display is proved to blink before anything moves, or before the first capture.

use super::*;
use crate::session::Watch;

fn watching(watch: Watch) -> Live {
    session_with(2, expected(), Options { watch, ..Options::default() })
}

fn blinks() -> Watched {
    Watched::Proof(DisplayProof {
        cycle_hz: 15.0,
        cycle_hz_sigma: 1e-3,
        dark_share: 0.5,
        cycles: 15,
        brighter_us: 0.0,
        darker_after_us: 33_333.0,
        jitter_us: 20.0,
        late_refreshes: 0,
        early_refreshes: 0,
        pixels: 30_000,
        extent_px: [0, 0, 100, 100],
        row_delays: Vec::new(),
    })
}

fn walked(live: &mut Live, display: Watched) -> Vec<(f64, Command)> {
    let mut bench = Bench { display, ..Bench::new() };
    bench.give(live, &Input::Connected(Box::new(facts())));
    bench.walk(live, 32.0, |_, _| ());
    bench.commands
}

fn moves(commands: &[(f64, Command)]) -> usize {
    commands.iter().filter(|(_, c)| matches!(c, Command::Move { .. } | Command::Travel { .. })).count()
}

#[test]
fn a_display_that_blinks_is_watched_once_and_told() {
    for (watch, place) in [(Watch::AtStart, 0), (Watch::AtFirstPose, 2)] {
        let mut live = watching(watch);
        let commands = walked(&mut live, blinks());
        let watched: Vec<_> = (0..commands.len()).filter(|i| commands[*i].1 == Command::Watch).collect();
        assert_eq!(watched, [place], "{watch:?}: {commands:?}");
        assert_eq!(captures(&commands), [0, 1]);
        let outcome = live.into_outcome();
        assert_eq!(outcome.end, End::Complete);
        assert_eq!(outcome.display.map(|d| d.pixels), Some(30_000));
    }
}

#[test]
fn without_the_proof_nothing_moves_that_need_not() {
    let mut live = watching(Watch::AtStart);
    let commands = walked(&mut live, Watched::Problem("nothing blinks".into()));
    assert_eq!(moves(&commands), 0, "{commands:?}");
    assert!(!commands.iter().any(|(_, c)| *c == Command::Start));
    let End::PreflightFailed(findings) = live.into_outcome().end else { panic!() };
    assert_eq!(findings[0].to_string(), "display: nothing blinks");

    let mut live = watching(Watch::AtFirstPose);
    let commands = walked(&mut live, Watched::Problem("nothing blinks".into()));
    assert_eq!((moves(&commands), captures(&commands).len()), (1, 0), "{commands:?}");
    assert!(matches!(live.into_outcome().end, End::OperatorNeeded(why) if why.contains("nothing blinks")));
}

#[test]
fn the_arm_is_guarded_while_the_display_is_watched() {
    let mut live = watching(Watch::AtFirstPose);
    let mut bench = Bench { display: blinks(), ..Bench::new() };
    bench.give(&mut live, &Input::Connected(Box::new(facts())));
    while !bench.commands.iter().any(|(_, c)| *c == Command::Watch) {
        bench.walk(&mut live, 0.008, |_, _| ());
    }
    bench.answers.clear();
    bench.walk(&mut live, 0.5, |_, _| ());
    assert!(!live.is_done());
    bench.walk(&mut live, 0.1, |_, s| s.safety_mode = 3);
    assert!(matches!(bench.commands.last(), Some((_, Command::Stop { .. }))), "{:?}", bench.commands);
}
