//! Synthetic sessions with known clocks, and everything that can be wrong with their edges.

use rand::{Rng as _, SeedableRng as _};
use rand_distr::{Distribution as _, Normal};
use rand_pcg::Pcg64;

use super::*;

const PERIOD_S: f64 = 0.1;
const EXPOSURE_S: f64 = 0.0999;
const SETTINGS: SyncSettings =
    SyncSettings { channel: 0, exposure_s: EXPOSURE_S, frame_period_s: PERIOD_S, arrivals: None };
const CLOCK: ClockMap = ClockMap { offset_s: 3217.4, ppm: 12.0 };

/// A session whose clocks and pulses are known.
struct Session {
    clock: ClockMap,
    /// Rise and fall of each exposure, microseconds of the sensor's clock, pose by pose.
    exposing_us: Vec<Vec<(i64, i64)>>,
    /// Rise and fall of the closing pulse of each pose.
    closing_us: Vec<Option<(i64, i64)>>,
    exposures: Vec<ExposureTime>,
    extra: Vec<Trigger>,
}

impl Session {
    /// `per_pose` exposures at each of the given starts (seconds since sensor second 8), host stamps off by
    /// `jitter_s` (standard deviation).
    fn new(clock: ClockMap, starts_s: &[f64], per_pose: usize, jitter_s: f64, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let jitter = Normal::new(0.0, jitter_s).unwrap();
        let mut session = Self { clock, exposing_us: vec![], closing_us: vec![], exposures: vec![], extra: vec![] };
        for (pose, start_s) in starts_s.iter().enumerate() {
            let at_us = |index: usize| ((8.0 + start_s + PERIOD_S * index as f64) * 1e6).round() as i64;
            let pulse = |index: usize, length_s: f64| (at_us(index), at_us(index) + (length_s * 1e6) as i64);
            session.exposing_us.push((0..per_pose).map(|index| pulse(index, EXPOSURE_S)).collect());
            session.closing_us.push(Some(pulse(per_pose, 0.005)));
            for (rise_us, fall_us) in &session.exposing_us[pose] {
                let start_host_s = clock.host_s_from_sensor_us(*rise_us) + jitter.sample(&mut random);
                let end_host_s = clock.host_s_from_sensor_us(*fall_us) + jitter.sample(&mut random);
                session.exposures.push(ExposureTime { pose, start_host_s, end_host_s, closing: false });
            }
        }
        session
    }

    /// Poses about 5 s apart, as a robot makes them.
    fn uneven(poses: usize, per_pose: usize, seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed ^ 0xabc);
        let mut start_s = 0.0;
        let starts_s: Vec<f64> = (0..poses)
            .map(|_| {
                start_s += random.random_range(4.0..6.0);
                start_s
            })
            .collect();
        Self::new(CLOCK, &starts_s, per_pose, 20e-6, seed)
    }

    /// Poses exactly 5 s apart.
    fn even(poses: usize, per_pose: usize, seed: u64) -> Self {
        let starts_s: Vec<f64> = (0..poses).map(|pose| 5.0 * pose as f64).collect();
        Self::new(CLOCK, &starts_s, per_pose, 20e-6, seed)
    }

    fn triggers(&self) -> Vec<Trigger> {
        let pulses = self.exposing_us.iter().flatten().chain(self.closing_us.iter().flatten());
        let edges = pulses.flat_map(|&(rise_us, fall_us)| [edge(rise_us, true), edge(fall_us, false)]);
        let mut triggers: Vec<Trigger> = edges.chain(self.extra.iter().copied()).collect();
        triggers.sort_by_key(|trigger| trigger.t_us);
        triggers
    }

    fn pulse(&mut self, rise_us: i64, length_us: i64) {
        self.extra.extend([edge(rise_us, true), edge(rise_us + length_us, false)]);
    }

    /// The same edges without the rising and falling edge of one exposure.
    fn triggers_without(&self, pose: usize, index: usize) -> Vec<Trigger> {
        let (rise_us, fall_us) = self.exposing_us[pose][index];
        self.triggers().into_iter().filter(|t| ![rise_us, fall_us].contains(&t.t_us)).collect()
    }

    fn find(&self) -> Result<TriggerSync, SyncError> {
        TriggerSync::find(&self.triggers(), &self.exposures, &SETTINGS)
    }

    /// The window that an exposure has if nothing is missing.
    fn window(&self, pose: usize, index: usize) -> Window {
        let start_us = self.exposing_us[pose][index].0;
        let next = self.exposing_us[pose].get(index + 1).copied().or(self.closing_us[pose]);
        let end_us = next.map_or(start_us + 100_000, |pulse| pulse.0);
        Window { start_us, end_us, assumed_end: next.is_none() }
    }

    fn all_windows(&self) -> Vec<Option<Window>> {
        let indices = self.exposing_us.iter().enumerate().flat_map(|(p, pose)| (0..pose.len()).map(move |i| (p, i)));
        indices.map(|(pose, index)| Some(self.window(pose, index))).collect()
    }

    /// Checks clock and noise against the truth; five standard deviations of a fit to `n` stamps with `jitter_s`.
    fn assert_clock(&self, found: &TriggerSync, jitter_s: f64) {
        let times_s: Vec<f64> = self.exposing_us.iter().flatten().map(|pulse| pulse.0 as f64 * 1e-6).collect();
        let n = times_s.len() as f64;
        let mean_s = times_s.iter().sum::<f64>() / n;
        let spread_s = (times_s.iter().map(|t| (t - mean_s).powi(2)).sum::<f64>() / n).sqrt();
        let ppm_sigma = 1e6 * jitter_s / spread_s / n.sqrt();
        assert!((found.clock.ppm - self.clock.ppm).abs() <= 5.0 * ppm_sigma, "{} ppm", found.clock.ppm);
        let middle_us = (mean_s * 1e6) as i64;
        let error_s = found.clock.host_s_from_sensor_us(middle_us) - self.clock.host_s_from_sensor_us(middle_us);
        assert!(error_s.abs() <= 5.0 * jitter_s / n.sqrt() + 1e-6, "{error_s} s");
        assert!((found.residual_rms_s / jitter_s - 1.0).abs() <= 5.0 / n.sqrt(), "{} s", found.residual_rms_s);
    }
}

fn edge(t_us: i64, rising: bool) -> Trigger {
    Trigger { t_us, channel: 0, rising }
}

#[test]
fn undisturbed_sessions_are_understood_whole() {
    for (session, per_pose) in
        [(Session::uneven(60, 1, 1), 1), (Session::uneven(60, 3, 2), 3), (Session::even(60, 1, 3), 1)]
    {
        let found = session.find().unwrap();
        session.assert_clock(&found, 20e-6);
        assert_eq!(found.windows, session.all_windows());
        assert_eq!((found.matched, found.unmatched_edges, found.doubled_edges), (60 * per_pose, 0, 0));
        assert_eq!(found.notes, [""; 0]);
    }
}

#[test]
fn offsets_and_drifts_of_any_size() {
    for (offset_s, ppm) in [(0.0, 0.0), (-913.7, -199.0), (1_791_000_000.25, 150.0), (3217.4, 199.0)] {
        let mut random = Pcg64::seed_from_u64(4);
        let starts_s: Vec<f64> = (0..300).map(|pose| 12.0 * f64::from(pose) + random.random_range(0.0..2.0)).collect();
        let session = Session::new(ClockMap { offset_s, ppm }, &starts_s, 3, 20e-6, 5);
        let found = session.find().unwrap();
        session.assert_clock(&found, 20e-6);
        assert_eq!(found.windows, session.all_windows());
    }
}

#[test]
fn a_missing_first_edge_shifts_nothing() {
    for session in [Session::uneven(60, 1, 6), Session::uneven(60, 3, 7), Session::even(60, 3, 8)] {
        let found = TriggerSync::find(&session.triggers_without(0, 0), &session.exposures, &SETTINGS).unwrap();
        session.assert_clock(&found, 20e-6);
        let mut expected = session.all_windows();
        expected[0] = None;
        assert_eq!(found.windows, expected);
        assert_eq!(found.matched, session.exposures.len() - 1);
        assert!(found.notes[0].contains("no trigger edge") && found.notes[0].contains("poses 0"), "{:?}", found.notes);
    }
}

#[test]
fn a_missing_edge_midway_is_flagged_and_so_is_the_window_before() {
    for session in [Session::uneven(60, 3, 9), Session::even(60, 3, 10)] {
        let found = TriggerSync::find(&session.triggers_without(20, 1), &session.exposures, &SETTINGS).unwrap();
        let mut expected = session.all_windows();
        let start_us = session.exposing_us[20][0].0;
        expected[60] = Some(Window { start_us, end_us: start_us + 100_000, assumed_end: true });
        expected[61] = None;
        assert_eq!(found.windows, expected);
        assert_eq!(found.notes.len(), 2, "{:?}", found.notes);
    }
    let session = Session::even(60, 1, 11);
    let found = TriggerSync::find(&session.triggers_without(30, 0), &session.exposures, &SETTINGS).unwrap();
    assert_eq!((found.matched, found.windows[30]), (59, None));
    session.assert_clock(&found, 20e-6);
}

#[test]
fn a_missing_closing_pulse_ends_the_window_after_one_period() {
    for per_pose in [1, 3] {
        let mut session = Session::uneven(60, per_pose, 12);
        session.closing_us[7] = None;
        session.closing_us[59] = None;
        let found = session.find().unwrap();
        assert_eq!(found.windows, session.all_windows());
        assert!(found.windows[8 * per_pose - 1].unwrap().assumed_end);
        assert!(found.notes[0].contains("2 exposures") && found.notes[0].contains("poses 7, 59"), "{:?}", found.notes);
    }
}

#[test]
fn doubled_edges_count_once() {
    let mut session = Session::uneven(60, 3, 13);
    let bounce_us = [session.exposing_us[3][0].0, session.exposing_us[9][2].0, session.closing_us[5].unwrap().0];
    // Once with a falling edge between, once without, once at a closing pulse.
    session.extra.extend([edge(bounce_us[0] + 150, false), edge(bounce_us[0] + 300, true)]);
    session.extra.push(edge(bounce_us[1] + 900, true));
    session.extra.push(edge(bounce_us[2] + 20, true));
    let found = session.find().unwrap();
    assert_eq!((found.doubled_edges, found.unmatched_edges), (3, 0));
    assert_eq!(found.windows, session.all_windows());
}

#[test]
fn extra_edges_before_after_and_between_are_left_over() {
    for mut session in [Session::uneven(60, 1, 14), Session::uneven(60, 3, 15), Session::even(60, 3, 16)] {
        let last_us = session.closing_us[59].unwrap().0;
        // The camera ran free before and after the session, and something else pulsed between poses.
        for index in 0..40 {
            session.pulse(500_000 + index * 100_000, 99_900);
            session.pulse(last_us + 3_000_000 + index * 100_000, 99_900);
        }
        session.pulse(session.exposing_us[11][0].0 - 1_234_567, 70_000);
        let found = session.find().unwrap();
        session.assert_clock(&found, 20e-6);
        assert_eq!(found.windows, session.all_windows());
        assert_eq!(found.unmatched_edges, 81);
    }
}

#[test]
fn an_edge_during_an_exposure_does_not_cut_its_window() {
    let mut session = Session::uneven(60, 3, 17);
    let rise_us = session.exposing_us[4][1].0;
    session.extra.push(edge(rise_us + 40_000, true));
    let found = session.find().unwrap();
    assert_eq!(found.windows, session.all_windows());
    assert_eq!(found.unmatched_edges, 1);
    assert!(found.notes[0].contains("while still exposing"), "{:?}", found.notes);
}

#[test]
fn everything_at_once() {
    for seed in 0..20 {
        let mut session = Session::uneven(60, 1 + 2 * (seed as usize % 2), 100 + seed);
        let mut random = Pcg64::seed_from_u64(seed);
        let end_us = session.closing_us[59].unwrap().0;
        for _ in 0..30 {
            let pose = random.random_range(0..60);
            match random.random_range(0..4) {
                0 => session.closing_us[pose] = None,
                1 => session.extra.push(edge(session.exposing_us[pose][0].0 + random.random_range(1..900), true)),
                _ => session.pulse(random.random_range(0..end_us), random.random_range(60_000..120_000)),
            }
        }
        let lost: Vec<i64> = (0..60).filter(|_| random.random_bool(0.1)).map(|p| session.exposing_us[p][0].0).collect();
        let triggers: Vec<Trigger> = session.triggers().into_iter().filter(|t| !lost.contains(&t.t_us)).collect();
        let found = TriggerSync::find(&triggers, &session.exposures, &SETTINGS).unwrap();
        let probe_us = end_us / 2;
        let error_s = found.clock.host_s_from_sensor_us(probe_us) - session.clock.host_s_from_sensor_us(probe_us);
        assert!(error_s.abs() < 20e-6, "seed {seed}: {error_s}");
        for (window, truth) in found.windows.iter().zip(session.all_windows()) {
            let (Some(window), Some(truth)) = (window, truth) else { continue };
            // The start is the edge, or its bounce where the edge itself is lost.
            assert!((window.start_us - truth.start_us).abs() < 900, "seed {seed}: {window:?} {truth:?}");
        }
    }
}

#[test]
fn late_host_stamps_do_not_bend_the_clock() {
    let mut session = Session::uneven(60, 3, 18);
    session.exposures.iter_mut().step_by(19).for_each(|exposure| exposure.start_host_s += 3e-3);
    let found = session.find().unwrap();
    session.assert_clock(&found, 20e-6);
    assert_eq!(found.windows, session.all_windows());
    assert!(found.notes[0].contains("10 exposures are far off"), "{:?}", found.notes);
}

#[test]
fn order_of_input_does_not_matter() {
    let session = Session::uneven(60, 3, 19);
    let expected = session.find().unwrap();
    let (mut triggers, mut exposures) = (session.triggers(), session.exposures.clone());
    triggers.reverse();
    exposures.reverse();
    let mut found = TriggerSync::find(&triggers, &exposures, &SETTINGS).unwrap();
    found.windows.reverse();
    assert_eq!(found, expected);
}

#[test]
fn what_fits_twice_is_refused() {
    // One exposure a pose, evenly spaced, all pulses of one lost at an end: shifted by a pose it fits as well.
    for lost in [0, 59] {
        let mut session = Session::even(60, 1, 20);
        session.closing_us[lost] = None;
        let error = TriggerSync::find(&session.triggers_without(lost, 0), &session.exposures, &SETTINGS).unwrap_err();
        let SyncError::Ambiguous { offset_s, matched, other_offset_s, other_matched } = error else {
            panic!("{error}");
        };
        assert_eq!((matched, other_matched), (59, 59));
        assert!(((offset_s - other_offset_s).abs() - 5.0).abs() < 1e-3, "{offset_s} {other_offset_s}");
    }
    // A camera that ran free all the time.
    let mut session = Session::new(CLOCK, &[0.0], 100, 20e-6, 21);
    session.closing_us[0] = None;
    for index in 1..5 {
        session.pulse(8_000_000 - index * 100_000, 99_900);
    }
    assert!(matches!(session.find(), Err(SyncError::Ambiguous { matched: 100, other_matched: 100, .. })));
}

#[test]
fn closing_pulses_tell_where_starts_cannot() {
    let session = Session::even(60, 1, 26);
    let found = TriggerSync::find(&session.triggers_without(0, 0), &session.exposures, &SETTINGS).unwrap();
    let mut expected = session.all_windows();
    expected[0] = None;
    assert_eq!(found.windows, expected);
    // The camera ran free before the only pose.
    let mut session = Session::new(CLOCK, &[0.0], 100, 20e-6, 28);
    for index in 1..5 {
        session.pulse(8_000_000 - index * 100_000, 99_900);
    }
    assert_eq!(session.find().unwrap().windows, session.all_windows());
}

#[test]
fn unevenness_of_half_a_millisecond_is_enough_to_tell() {
    let mut random = Pcg64::seed_from_u64(22);
    let starts_s: Vec<f64> = (0..60).map(|pose| 5.0 * f64::from(pose) + random.random_range(0.0..0.5e-3)).collect();
    let mut session = Session::new(CLOCK, &starts_s, 1, 20e-6, 23);
    session.closing_us[0] = None;
    let found = TriggerSync::find(&session.triggers_without(0, 0), &session.exposures, &SETTINGS).unwrap();
    session.assert_clock(&found, 20e-6);
}

#[test]
fn senseless_input_is_named() {
    let session = Session::uneven(60, 1, 24);
    let triggers = session.triggers();
    let find = |exposures: &[ExposureTime], settings| TriggerSync::find(&triggers, exposures, &settings).unwrap_err();
    let message = find(&session.exposures, SyncSettings { channel: 6, ..SETTINGS }).to_string();
    assert!(message.contains("channel 6") && message.contains("[0]"), "{message}");
    for bad in [f64::NAN, 0.0, -1.0, f64::INFINITY] {
        let error = find(&session.exposures, SyncSettings { frame_period_s: bad, ..SETTINGS });
        assert!(matches!(error, SyncError::Setting { name: "frame_period_s", .. }));
        let error = find(&session.exposures, SyncSettings { exposure_s: bad, ..SETTINGS });
        assert!(matches!(error, SyncError::Setting { name: "exposure_s", .. }));
    }
    for (index, start_host_s) in [(3, f64::NAN), (4, f64::INFINITY), (5, 1e9), (6, session.exposures[5].start_host_s)] {
        let mut exposures = session.exposures.clone();
        exposures[index].start_host_s = start_host_s;
        let error = find(&exposures, SETTINGS);
        assert!(matches!(error, SyncError::Exposure { .. }), "{index}: {error}");
    }
    assert!(matches!(find(&[], SETTINGS), SyncError::TooFew { exposures: 0, edges: 60, closing: 60, .. }));
    // With ten times the exposure every pulse is a closing pulse.
    let error = find(&session.exposures[..1], SyncSettings { exposure_s: 0.999, ..SETTINGS });
    assert!(matches!(error, SyncError::TooFew { edges: 0, closing: 120, .. }), "{error}");
    let wild = [i64::MIN, -1, 0, 1, i64::MAX].map(|t_us| edge(t_us, true));
    assert!(TriggerSync::find(&wild, &session.exposures, &SETTINGS).is_err());
}

#[test]
fn events_of_another_session_do_not_fit() {
    for seed in 0..5 {
        let (one, other) = (Session::uneven(60, 3, 30 + seed), Session::uneven(60, 3, 40 + seed));
        let error = TriggerSync::find(&one.triggers(), &other.exposures, &SETTINGS).unwrap_err();
        assert!(matches!(error, SyncError::NoAlignment { exposures: 180, edges: 180, closing: 60 }), "{error}");
    }
}

#[test]
fn a_noisy_host_is_refused() {
    let starts_s: Vec<f64> = (0..60).map(|pose| 5.3 * f64::from(pose) + 0.4 * f64::from(pose % 7)).collect();
    let session = Session::new(CLOCK, &starts_s, 1, 3e-3, 25);
    assert!(matches!(session.find(), Err(SyncError::Residual { .. })), "{:?}", session.find());
}

#[test]
fn clock_map_and_back() {
    for clock in [CLOCK, ClockMap { offset_s: -1e9, ppm: -200.0 }] {
        for sensor_us in [0, 1, 3_600_000_000] {
            let back_us = clock.sensor_us_from_host_s(clock.host_s_from_sensor_us(sensor_us));
            assert!((back_us - sensor_us).abs() <= 1);
        }
    }
    let second_s = CLOCK.host_s_from_sensor_us(1_000_000);
    assert!((second_s - 3_218.400_012).abs() < 1e-9, "{second_s}");
    assert_eq!(CLOCK.sensor_us_from_host_s(f64::NAN), 0);
}

/// What packets of 20 ms from 0.2 s before each pose on say, late by 2 ms and up to 6 more.
fn arrivals(session: &Session, seed: u64) -> HostClock {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut all = Vec::new();
    for pose in &session.exposing_us {
        let (first_us, last_us) = (pose[0].0 - 200_000, pose[pose.len() - 1].1 + 20_000);
        for last_us in (first_us..last_us).step_by(20_000) {
            let latency_s = 0.002 + 0.006 * random.random::<f64>();
            all.push(Arrival { last_us, host_s: session.clock.host_s_from_sensor_us(last_us) + latency_s });
        }
    }
    HostClock::find(&all).unwrap()
}

/// A camera that runs freely exposes before and after its captures too, and no pulse closes them.
fn free_running(seed: u64) -> Session {
    let mut session = Session::uneven(12, 3, seed);
    session.closing_us.fill(None);
    for pose in session.exposing_us.clone() {
        for k in [-2, -1, 3] {
            session.pulse(pose[0].0 + k * 100_000, (EXPOSURE_S * 1e6) as i64);
        }
    }
    session
}

#[test]
fn a_free_running_camera_is_ambiguous_alone_and_clear_with_arrivals() {
    for seed in 0..10 {
        let session = free_running(seed);
        let alone = session.find();
        assert!(matches!(alone, Err(SyncError::Ambiguous { .. })), "{seed}: {alone:?}");
        let settings = SyncSettings { arrivals: Some(arrivals(&session, seed)), ..SETTINGS };
        let found = TriggerSync::find(&session.triggers(), &session.exposures, &settings).unwrap();
        session.assert_clock(&found, 20e-6);
        for (window, exposure) in found.windows.iter().zip(session.exposing_us.iter().flatten()) {
            let window = window.unwrap();
            assert_eq!((window.start_us, window.end_us), (exposure.0, exposure.0 + 100_000), "{seed}");
        }
    }
}

#[test]
fn a_pairing_that_is_off_by_an_image_is_told_not_averaged() {
    for (seed, images) in [(1, 1), (2, -1), (3, 2)] {
        let mut session = Session::uneven(12, 3, seed);
        let settings = SyncSettings { arrivals: Some(arrivals(&session, seed)), ..SETTINGS };
        // The driver gives every image the time of another.
        for exposure in &mut session.exposures {
            exposure.start_host_s += PERIOD_S * f64::from(images);
            exposure.end_host_s += PERIOD_S * f64::from(images);
        }
        let error = TriggerSync::find(&session.triggers(), &session.exposures, &settings).unwrap_err();
        let SyncError::Shifted { by_s, images: found } = error else { panic!("{seed}: {error}") };
        // The arrivals are late by 2 ms and a little.
        assert!((by_s - PERIOD_S * f64::from(images) + 0.0025).abs() < 0.001, "{seed}: {by_s}");
        assert!((found - i64::from(images)).abs() <= 1, "{seed}: {found}");
    }
}

#[test]
fn arrivals_that_are_very_late_still_tell_the_image() {
    let session = free_running(4);
    let mut late = arrivals(&session, 4);
    // The slowest way there is: half an image later.
    late.clock.offset_s += 0.05;
    let settings = SyncSettings { arrivals: Some(late), ..SETTINGS };
    let found = TriggerSync::find(&session.triggers(), &session.exposures, &settings).unwrap();
    session.assert_clock(&found, 20e-6);
}
