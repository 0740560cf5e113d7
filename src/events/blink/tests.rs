//! Displays of known rate, phase and flaws, seen by noisy pixels.

use rand::{Rng as _, SeedableRng as _};
use rand_distr::{Distribution as _, Normal};
use rand_pcg::Pcg64;

use super::*;

const SIZE: [u16; 2] = [160, 120];
const EXPECTED: ExpectedBlink = ExpectedBlink { cycle_hz: 15.0, refresh_hz: 60.0 };
const JITTER_US: f64 = 100.0;

/// A display on 80 x 80 pixels with black cells of 8 pixels.
#[derive(Clone)]
struct Display {
    refresh_us: f64,
    per_state: u32,
    seconds: f64,
    scan_us: f64,
    /// Extra refreshes of the state with this index.
    extra: Vec<(usize, i32)>,
    noise_hz: f64,
    hot: usize,
    flicker_hz: f64,
    /// Share of pixels and transitions that answer.
    answers: f64,
}

impl Default for Display {
    fn default() -> Self {
        let (noise_hz, hot, flicker_hz, answers) = (0.3, 20, 0.0, 0.95);
        Self {
            refresh_us: 1e6 / 60.0,
            per_state: 2,
            seconds: 1.0,
            scan_us: 15e3,
            extra: Vec::new(),
            noise_hz,
            hot,
            flicker_hz,
            answers,
        }
    }
}

const PHASE_US: f64 = 5_123_456.0;

impl Display {
    /// Transition times and whether they are to brighter.
    fn transitions(&self) -> Vec<(f64, bool)> {
        let (mut at, mut all) = (PHASE_US, Vec::new());
        while at < PHASE_US + self.seconds * 1e6 {
            all.push((at, all.len() % 2 == 0));
            let extra = self.extra.iter().find(|(i, _)| *i + 1 == all.len()).map_or(0, |(_, n)| *n);
            at += self.refresh_us * f64::from(self.per_state as i32 + extra);
        }
        all
    }

    fn events(&self, seed: u64) -> Vec<Event> {
        let mut random = Pcg64::seed_from_u64(seed);
        let jitter = Normal::new(150.0, JITTER_US).unwrap();
        let mut events = Vec::new();
        for (at, on) in self.transitions() {
            for (x, y) in
                (40..120).flat_map(|x| (20..100).map(move |y| (x, y))).filter(|(x, y)| (x / 8 + y / 8) % 2 == 0)
            {
                if random.random::<f64>() > self.answers {
                    continue;
                }
                let scan = self.scan_us * f64::from(y - 20) / 80.0;
                let slow = if on { 2000.0 } else { 1500.0 } * random.random::<f64>();
                let t_us = (at + scan + slow + jitter.sample(&mut random)).round() as i64;
                events.push(Event { t_us, x, y, on });
            }
        }
        self.add_noise(&mut events, &mut random);
        events.sort();
        events
    }

    fn add_noise(&self, events: &mut Vec<Event>, random: &mut Pcg64) {
        let mut any = |x: u16, y: u16, random: &mut Pcg64| {
            let t_us = (PHASE_US + random.random::<f64>() * self.seconds * 1e6) as i64;
            events.push(Event { t_us, x, y, on: random.random() });
        };
        let [width, height] = SIZE;
        let background = f64::from(width) * f64::from(height) * self.noise_hz * self.seconds;
        for _ in 0..background as usize {
            any(random.random_range(0..width), random.random_range(0..height), random);
        }
        for hot in 0..self.hot {
            for _ in 0..(100.0 * self.seconds) as usize {
                any((hot * 7 % 160) as u16, (hot * 13 % 120) as u16, random);
            }
        }
        if self.flicker_hz > 0.0 {
            for i in 0..(self.seconds * self.flicker_hz) as usize {
                for x in (40..120).step_by(2) {
                    let at = PHASE_US + i as f64 / self.flicker_hz * 1e6;
                    let y = 20 + (i * 31 + usize::from(x) * 17) as u16 % 80;
                    events.push(Event { t_us: at as i64, x, y, on: true });
                    events.push(Event { t_us: (at + 0.5e6 / self.flicker_hz) as i64, x, y, on: false });
                }
            }
        }
    }

    fn proof(&self, seed: u64) -> Result<DisplayProof, DisplayProblem> {
        DisplayProof::find(&self.events(seed), SIZE, EXPECTED)
    }
}

#[test]
fn a_good_display_is_measured_as_well_as_its_jitter_allows() {
    for seed in 0..5 {
        let proof = Display::default().proof(seed).unwrap();
        // A transition is the median of 3,000 events spread over about 2 ms: good to 1.25 * 600 us / sqrt(3000) = 14 us;
        // the residual delay of a band of rows is shared by all of them. Four times the standard deviation of a slope
        // over 30 transitions.
        let sigma_us = 14.0 / (30.0_f64 * 75.0).sqrt();
        let period_us = 1e6 / proof.cycle_hz;
        assert!(
            (period_us - 1e6 / 15.0).abs() < 4.0 * sigma_us.max(proof.cycle_hz_sigma / 15.0 * period_us),
            "{proof:?}"
        );
        // Brighter takes up to 2 ms, darker 1.5: the difference of the means is 0.25 ms of 66.7.
        assert!((proof.dark_share - 0.5).abs() < 0.006, "{proof:?}");
        assert_eq!((proof.late_refreshes, proof.early_refreshes), (0, 0));
        assert!((proof.extent_px[0]..=proof.extent_px[2]).contains(&80), "{proof:?}");
        for (found, true_px) in proof.extent_px.iter().zip([40, 20, 119, 99]) {
            assert!(found.abs_diff(true_px) <= 2, "{proof:?}");
        }
        assert!(proof.jitter_us < 60.0, "{proof:?}");
        // From the first transition, with half of the slow answer, the latency and the mean scan-out.
        let since_us = (proof.brighter_us - PHASE_US).rem_euclid(1e6 / 15.0);
        assert!((since_us - 1000.0 - 150.0 - 7500.0).abs() < 500.0, "{since_us}");
        // The scan-out: rows 20 to 100 differ by 15 ms.
        let seen_us = proof.row_delay_us(92) - proof.row_delay_us(28);
        assert!((seen_us - 15e3 * 64.0 / 80.0).abs() < 400.0, "{seen_us}");
    }
}

#[test]
fn a_panel_of_59_94_hz_is_right_and_other_rates_are_named() {
    let at =
        |refresh_hz: f64, per_state: u32| Display { refresh_us: 1e6 / refresh_hz, per_state, ..Display::default() };
    let ntsc = at(59.94, 2).proof(1).unwrap();
    assert!((ntsc.cycle_hz - 14.985).abs() < 0.004, "{}", ntsc.cycle_hz);
    for (refresh_hz, per_state, truth_hz) in
        [(75.0, 2, 18.75), (75.0, 3, 12.5), (144.0, 5, 14.4), (144.0, 4, 18.0), (60.0, 1, 30.0), (60.0, 4, 7.5)]
    {
        let problem = at(refresh_hz, per_state).proof(2).unwrap_err();
        let DisplayProblem::WrongRate { found_hz, .. } = problem else { panic!("{truth_hz}: {problem}") };
        assert!((found_hz / truth_hz - 1.0).abs() < 1e-3, "{truth_hz}: {found_hz}");
    }
}

#[test]
fn refreshes_that_come_late_or_early_are_counted() {
    let display = Display { extra: vec![(7, 1), (12, 2), (21, -1)], ..Display::default() };
    let proof = display.proof(3).unwrap();
    assert_eq!((proof.late_refreshes, proof.early_refreshes), (3, 1));
    assert!((proof.cycle_hz - 15.0).abs() < 0.01, "{}", proof.cycle_hz);
}

#[test]
fn a_flickering_backlight_does_not_hide_the_rhythm() {
    for flicker_hz in [240.0, 480.0, 960.0] {
        let proof = Display { flicker_hz, ..Display::default() }.proof(4).unwrap();
        assert!((proof.cycle_hz - 15.0).abs() < 0.01, "{flicker_hz}: {}", proof.cycle_hz);
    }
}

#[test]
fn a_weak_display_is_still_one() {
    let proof = Display { answers: 0.4, ..Display::default() }.proof(5).unwrap();
    assert!((proof.cycle_hz - 15.0).abs() < 0.01);
}

#[test]
fn noise_alone_is_no_display() {
    for (noise_hz, hot) in [(0.6, 40), (0.0, 0), (3.0, 100)] {
        let problem = Display { answers: -1.0, noise_hz, hot, ..Display::default() }.proof(6).unwrap_err();
        let named = matches!(problem, DisplayProblem::NotVisible { .. } | DisplayProblem::NoRhythm { .. });
        assert!(named, "{problem}");
    }
    let nothing = DisplayProof::find(&[], SIZE, EXPECTED).unwrap_err();
    assert!(matches!(nothing, DisplayProblem::NotVisible { pixels: 0, .. }), "{nothing}");
}

#[test]
fn changes_without_rhythm_and_short_looks_are_named() {
    let mut random = Pcg64::seed_from_u64(7);
    let any = |_| Event {
        t_us: random.random_range(0..1_000_000),
        x: random.random_range(0..160),
        y: random.random_range(0..120),
        on: random.random(),
    };
    let mut events: Vec<Event> = (0..400_000).map(any).collect();
    events.sort();
    let problem = DisplayProof::find(&events, SIZE, EXPECTED).unwrap_err();
    assert!(matches!(problem, DisplayProblem::NoRhythm { .. }), "{problem}");
    let short = Display { seconds: 0.2, ..Display::default() }.proof(8).unwrap_err();
    assert!(matches!(short, DisplayProblem::TooShort { .. }), "{short}");
}

#[test]
fn absurd_input_is_no_panic() {
    let odd = ExpectedBlink { cycle_hz: f64::NAN, refresh_hz: 0.0 };
    let events: Vec<Event> =
        [i64::MIN, -5, 0, i64::MAX].map(|t_us| Event { t_us, x: u16::MAX, y: u16::MAX, on: true }).into();
    for size in [[0, 0], SIZE] {
        assert!(DisplayProof::find(&events, size, odd).is_err());
        assert!(DisplayProof::find(&events, size, EXPECTED).is_err());
    }
    let _ = DisplayProof::find(&Display::default().events(1), SIZE, odd);
}
