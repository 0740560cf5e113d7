//! Counts, balance, delays and rates against what the parameters imply; four standard deviations each.

use super::tests::{board, plain, pose, spec};
use super::*;
use crate::geometry::Event as EventFrame;

/// Abramowitz and Stegun 7.1.26; good to 1.5e-7.
fn normal_cdf(z: f64) -> f64 {
    let x = z.abs() / std::f64::consts::SQRT_2;
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let terms = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    let tail = terms.iter().fold(0.0, |sum, a| (sum + a) * t) * (-x * x).exp();
    if z > 0.0 { 1.0 - 0.5 * tail } else { 0.5 * tail }
}

/// Pixels well inside the squares of one colour, with the luminance step (natural logarithm) there.
fn inside_squares(scene: &Scene, event_from_target: &Transform<EventFrame, Target>, black: bool) -> Vec<[u16; 2]> {
    let mut pixels = Vec::new();
    for (column, row) in (0..7).flat_map(|x| (0..5).map(move |y| (x, y))).filter(|(x, y)| ((x + y) % 2 == 0) == black) {
        let centre = [(f64::from(column) + 0.5) * 0.0088, (f64::from(row) + 0.5) * 0.0088, 0.0];
        let [u, v] = scene.project_event(event_from_target, Point::assume_frame(centre)).unwrap();
        let around = |c: f64| (c.round() as i64 - 14..=c.round() as i64 + 14).map(|c| c as u16);
        pixels.extend(around(v).flat_map(|y| around(u).map(move |x| [x, y])));
    }
    pixels
}

/// Events of each polarity (darker, brighter) in a map by pixel.
fn counts(events: &[Event]) -> std::collections::HashMap<[u16; 2], [u32; 2]> {
    let mut counts = std::collections::HashMap::new();
    for event in events {
        counts.entry([event.x, event.y]).or_insert([0, 0])[usize::from(event.on)] += 1;
    }
    counts
}

#[test]
fn the_share_of_pixels_that_fire_follows_from_thresholds_and_contrast() {
    let mut spec = plain();
    spec.display.off_axis_dimming = 0.0;
    let event = EventSpec {
        threshold_on: 0.8,
        threshold_off: 0.9,
        threshold_mismatch: 0.2,
        high_pass_gain: 0.35,
        dark_cd_m2: 8.0,
        ..spec.event.as_ref().unwrap().1.clone()
    };
    spec.event.as_mut().unwrap().1 = event;
    let scene = Scene::new(spec).unwrap();
    let event_from_target = pose([0.0; 3], [0.0; 2]);
    // Ten cycles. Every pixel has its own thresholds once and for all: it fires always or never.
    let found = counts(&scene.events(&event_from_target, 2.0, 2.0 + 10.0 / 15.0));
    let black = inside_squares(&scene, &event_from_target, true);
    let blended = 0.32 + 3.0 + (391.0 - 0.32) * (153.0_f64 / 255.0).powf(2.2);
    let step = ((blended + 8.0) / (0.32 + 3.0 + 8.0)).ln();
    let mut sums = [0.0; 2];
    for (sign, threshold) in [(0, 0.9), (1, 0.8)] {
        let expected = normal_cdf((0.35 * step / threshold - 1.0) / 0.2);
        let fired: Vec<u32> = black.iter().filter_map(|p| found.get(p)).map(|n| n[sign]).filter(|n| *n > 0).collect();
        assert!(fired.iter().all(|n| (9..=11).contains(n)));
        let share = fired.len() as f64 / black.len() as f64;
        let sigma = (expected * (1.0 - expected) / black.len() as f64).sqrt();
        eprintln!("sign {sign}: {share:.4} of {} black pixels fire, {expected:.4} +- {sigma:.4} expected", black.len());
        assert!((share - expected).abs() < 4.0 * sigma, "{share} instead of {expected} +- {sigma}");
        sums[sign] = expected;
    }
    let [off, on] =
        black.iter().filter_map(|p| found.get(p)).fold([0.0; 2], |s, n| [0, 1].map(|i| s[i] + f64::from(n[i])));
    let expected = sums[1] / (sums[0] + sums[1]);
    // The draws are pixels, not events; the ends of the window add or take one burst of twenty.
    let sigma = (expected * (1.0 - expected) / (black.len() as f64 * (sums[0] + sums[1]))).sqrt();
    let balance = on / (on + off);
    assert!((balance - expected).abs() < 4.0 * sigma + 1.0 / 40.0, "{balance} ON instead of {expected}");
    let white = inside_squares(&scene, &event_from_target, false);
    assert_eq!(white.iter().filter(|p| found.contains_key(*p)).count(), 0);
}

#[test]
fn delays_have_the_mean_and_the_spread_of_their_parts() {
    let mut spec = plain();
    spec.display = DisplaySpec { rise_s: 1e-5, fall_s: 1e-5, scan_out_s: 0.0, ..spec.display };
    let event = &mut spec.event.as_mut().unwrap().1;
    (event.latency_s, event.jitter_s, event.row_readout_s) = (600e-6, 75e-6, 200e-6);
    let scene = Scene::new(spec).unwrap();
    let events = scene.events(&pose([0.0; 3], [0.0; 2]), 1.0, 1.5);
    let starts = scene.blink.transitions(1.0, 1.5, 0.0);
    let delay_us = |event: &Event| {
        let t_s = event.t_us as f64 * 1e-6;
        let start = starts.iter().rev().find(|t| t.start_s <= t_s).unwrap();
        assert_eq!(start.brighter(), event.on);
        1e6 * (t_s - start.start_s)
    };
    let delays: Vec<f64> = events.iter().map(delay_us).collect();
    let n = delays.len() as f64;
    let mean = delays.iter().sum::<f64>() / n;
    let deviation = (delays.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n).sqrt();
    // The wait for the readout is uniform and shared by the row: rows times transitions are the draws.
    let (wait, jitter): (f64, f64) = (200.0 / 12.0_f64.sqrt(), 75.0);
    let rows: std::collections::HashSet<u16> = events.iter().map(|e| e.y).collect();
    let draws = rows.len() as f64 * 15.0;
    let (expected, sigma) = (700.0, (wait * wait / draws + jitter * jitter / n).sqrt());
    let spread = wait.hypot(jitter);
    eprintln!("delay {mean:.2} us ({expected} +- {sigma:.2}), deviation {deviation:.2} us ({spread:.2})");
    // The liquid crystal itself takes 4.6 us to settle, and a pixel fires within that.
    assert!((-4.0 * sigma..4.0 * sigma + 5.0).contains(&(mean - expected)), "{mean} us");
    assert!((deviation / spread - 1.0).abs() < 4.0 / (2.0 * draws).sqrt(), "{deviation} us instead of {spread}");
}

#[test]
fn noise_without_light_is_poisson_at_its_rate() {
    let mut spec = spec();
    spec.display.off = true;
    spec.event.as_mut().unwrap().1.background_hz = 0.5;
    let scene = Scene::new(spec).unwrap();
    let hot: std::collections::HashSet<_> = scene.event.as_ref().unwrap().hot_pixels.iter().copied().collect();
    let (seconds, pixels) = (6.0, 480.0 * 360.0 - hot.len() as f64);
    let events = scene.events(&pose([0.0; 3], [0.0; 2]), 0.0, seconds);
    let by_pixel = counts(&events);
    let quiet = || by_pixel.iter().filter(|(place, _)| !hot.contains(*place)).map(|(_, n)| f64::from(n[0] + n[1]));
    let (total, mean) = (quiet().sum::<f64>(), 0.5 * seconds);
    assert!((total - mean * pixels).abs() < 4.0 * (mean * pixels).sqrt(), "{total} instead of {}", mean * pixels);
    let silent = pixels - quiet().count() as f64;
    let variance = (quiet().map(|n| (n - mean).powi(2)).sum::<f64>() + silent * mean * mean) / pixels;
    let sigma = (2.0 / pixels + 1.0 / (mean * pixels)).sqrt();
    eprintln!("background {:.4} Hz (0.5), variance over mean {:.4}", total / pixels / seconds, variance / mean);
    assert!((variance / mean - 1.0).abs() < 4.0 * sigma, "{variance} for a mean of {mean}");
    let on = events.iter().filter(|e| e.on).count() as f64;
    assert!((on - events.len() as f64 / 2.0).abs() < 2.0 * (events.len() as f64).sqrt());
    let fired: f64 = hot.iter().filter_map(|p| by_pixel.get(p)).map(|n| f64::from(n[0] + n[1])).sum();
    let expected = (40.0 * 100.0 + hot.len() as f64 * 0.5) * seconds;
    eprintln!("hot pixels {fired} events ({expected})");
    assert!((fired - expected).abs() < 4.0 * expected.sqrt(), "{fired} instead of {expected}");
}

#[test]
fn a_modulated_backlight_fires_twice_a_period_where_the_pixel_can_follow() {
    let scene = |low_pass_hz: f64, flicker_events_per_s: f64| {
        let mut spec = plain();
        (spec.display.pwm_hz, spec.display.frozen) = (240.0, true);
        let event = &mut spec.event.as_mut().unwrap().1;
        (event.low_pass_hz, event.flicker_events_per_s) = (low_pass_hz, flicker_events_per_s);
        Scene::new(spec).unwrap()
    };
    let event_from_target = pose([0.0; 3], [0.0; 2]);
    let (from_s, to_s) = (1.0, 1.05);
    let fast = scene(300.0, 2e8);
    let found = counts(&fast.events(&event_from_target, from_s, to_s));
    for pixel in inside_squares(&fast, &event_from_target, false) {
        let [off, on] = found.get(&pixel).copied().unwrap_or_default();
        assert!((11..=13).contains(&on) && (11..=13).contains(&off), "{pixel:?}: {on} ON and {off} OFF");
    }
    let all: u32 = found.values().flatten().sum();
    // At 1 Hz the swing of the logarithm is a hundredth of its 4.9.
    assert!(scene(1.0, 2e8).events(&event_from_target, from_s, to_s).is_empty());
    let limited = scene(300.0, 2e6).events(&event_from_target, from_s, to_s).len() as f64;
    assert!(f64::from(all) > 3e5 && (limited - 1e5).abs() < 4.0 * 1e5_f64.sqrt() + 2e3, "{limited} of {all}");
    let steady = {
        let mut spec = plain();
        spec.display.frozen = true;
        Scene::new(spec).unwrap()
    };
    let mean = |scene: &Scene, start_s, exposure_s| {
        let image = scene.expose(&pose([0.0; 3], [0.0; 2]), start_s, exposure_s);
        image.pixels.iter().map(|p| f64::from(*p)).sum::<f64>() / image.pixels.len() as f64
    };
    let bright = mean(&steady, 0.2, 0.1);
    assert!((mean(&fast, 0.2, 0.1) / bright - 1.0).abs() < 0.01);
    assert!((mean(&fast, 0.0001, 0.0015) / bright - 2.0).abs() < 0.2);
}

#[test]
fn dropped_refreshes_delay_what_follows_as_often_as_they_should() {
    let display = DisplaySpec { dropped_refreshes: 0.02, ..DisplaySpec::default() };
    let blink = Blink::new(&display, 15.0, 5);
    let all = blink.transitions(0.0, 1000.0, 0.0);
    let waits = all.windows(2).filter(|p| p[0].index >= 0).map(|p| 60.0 * (p[1].start_s - p[0].start_s));
    let waits: Vec<f64> = waits.collect();
    assert!(waits.iter().all(|w| (w - w.round()).abs() < 1e-6 && *w > 1.999));
    let (shown, late) = (2.0 * waits.len() as f64, waits.iter().map(|w| w - 2.0).sum::<f64>());
    let sigma = (shown * 0.02 * 0.98).sqrt();
    eprintln!("{late:.0} of {shown} refreshes repeated ({:.0} +- {sigma:.0})", 0.02 * shown);
    assert!((late - 0.02 * shown).abs() < 4.0 * sigma, "{late} of {shown}");
    // The mean over an exposure is the sum over its instants, wherever it begins.
    for start_s in [3.0, 77.77, 500.005] {
        let steps = 2000;
        let instants = (0..steps).map(|i| blink.mean_blend(start_s + 0.2 * f64::from(i) / f64::from(steps), 1e-4, 0.3));
        let (summed, whole) = (instants.sum::<f64>() / f64::from(steps), blink.mean_blend(start_s, 0.2, 0.3));
        assert!((summed - whole).abs() < 1e-3, "{start_s}: {summed} {whole}");
    }
    let rate = Blink::new(&DisplaySpec { actual_cycle_hz: Some(14.4), ..DisplaySpec::default() }, 15.0, 5);
    let all = rate.transitions(0.0, 100.0, 0.0);
    assert!(all.windows(2).all(|p| (p[1].start_s - p[0].start_s - 0.5 / 14.4).abs() < 1e-9));
}

#[test]
fn windows_that_meet_join_with_flicker_and_dropped_refreshes() {
    let mut spec = spec();
    spec.display = DisplaySpec { pwm_hz: 200.0, dropped_refreshes: 0.2, ..spec.display };
    let scene = Scene::new(spec).unwrap();
    let event_from_target = pose([0.1, 0.0, 0.0], [0.0; 2]);
    let whole = scene.events(&event_from_target, 3.0, 3.12);
    let cuts = [3.0, 3.0123, 3.0371, 3.05, 3.0501, 3.12];
    let parts = cuts.windows(2).flat_map(|cut| scene.events(&event_from_target, cut[0], cut[1]));
    assert!(whole == parts.collect::<Vec<_>>());
}

#[test]
fn a_frozen_display_shows_its_pattern_and_a_dark_one_nothing() {
    let still = |frozen: bool| {
        let mut spec = plain();
        (spec.display.frozen, spec.display.off) = (frozen, !frozen);
        Scene::new(spec).unwrap()
    };
    let at = pose([0.0; 3], [0.0; 2]);
    let (frozen, dark) = (still(true), still(false));
    assert!(frozen.events(&at, 0.0, 0.5).is_empty() && dark.events(&at, 0.0, 0.5).is_empty());
    let rgb_from_target = pose([0.0; 3], [0.0; 2]);
    let (image, pattern) =
        (frozen.expose(&rgb_from_target, 0.0, 0.1), frozen.state_rgb(&rgb_from_target, State::Pattern));
    // Noise is cut off at 0, so only what is bright has the mean of its noise.
    let bright = image.pixels.iter().zip(&pattern.pixels).filter(|(_, clean)| **clean > 20);
    let off: Vec<f64> = bright.map(|(noisy, clean)| f64::from(*noisy) - f64::from(*clean)).collect();
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    assert!(off.len() > 10_000 && mean.abs() < 0.5, "{mean} DN over {} pixels", off.len());
    assert!(dark.expose(&rgb_from_target, 0.0, 0.1).pixels.iter().all(|v| *v < 8));
}

#[test]
fn a_reflection_silences_what_it_covers_and_follows_the_camera() {
    let spot = Spotlight { cd_m2: 2000.0, centre_m: [0.0132, 0.0132], radius_m: 0.004, lamp_distance_m: None };
    let fired = |spotlight: Option<Spotlight>, shift_m: [f64; 2]| {
        let mut spec = plain();
        spec.display.spotlight = spotlight;
        spec.event.as_mut().unwrap().1.high_pass_gain = 0.35;
        let scene = Scene::new(spec).unwrap();
        let event_from_target = pose([0.0; 3], shift_m);
        let found = counts(&scene.events(&event_from_target, 1.0, 1.1));
        let square = |x: f64, y: f64| {
            let [u, v] = scene.project_event(&event_from_target, Point::assume_frame([x, y, 0.0])).unwrap();
            let near = |p: &&[u16; 2]| (f64::from(p[0]) - u).abs() < 10.0 && (f64::from(p[1]) - v).abs() < 10.0;
            found.keys().filter(near).count()
        };
        (square(0.0132, 0.0132), square(0.0484, 0.0308))
    };
    let (clear, elsewhere) = fired(None, [0.0; 2]);
    assert!(clear > 300 && elsewhere > 300);
    let (covered, elsewhere) = fired(Some(spot.clone()), [0.0; 2]);
    assert!(covered == 0 && elsewhere > 300, "{covered} {elsewhere}");
    let moving = Spotlight { lamp_distance_m: Some(0.29), ..spot };
    // Half way between the foot of the lamp and that of the camera.
    let reflection = moving.seen_from(&nalgebra::Vector3::new(0.0332, 0.0132, -0.29));
    assert!((reflection.at([0.0232, 0.0132].into()) - 2000.0).abs() < 1e-3);
}

#[test]
fn an_occluder_hides_what_lies_behind_it_as_each_camera_sees_it() {
    let mut spec = plain();
    let corners_m = vec![[-0.02, -0.02], [0.02, -0.02], [0.02, 0.06], [-0.02, 0.06]];
    spec.display.occluders = vec![Occluder { corners_m, height_m: 0.02, cd_m2: 1.0 }];
    let scene = Scene::new(spec).unwrap();
    for shift_m in [[0.0; 2], [0.01, 0.0]] {
        let (rgb, event) = (pose::<Rgb>([0.0; 3], shift_m), pose::<EventFrame>([0.0; 3], shift_m));
        let edge = scene.project_rgb(&rgb, Point::assume_frame([0.02, 0.022, -0.02])).unwrap();
        let image = scene.state_rgb(&rgb, State::Blended);
        let row = edge[1].round() as usize;
        let first = (0..480).rfind(|x| image.at(*x, row) < 10 && *x as f64 <= edge[0] + 3.0).unwrap() as f64;
        assert!((first - edge[0]).abs() < 2.5, "{first} {edge:?}");
        let events = scene.events(&event, 0.0, 0.2);
        assert!(
            events.len() > 1000
                && events.iter().filter(|e| e.y.abs_diff(row as u16) < 20).all(|e| f64::from(e.x) > edge[0] - 2.0)
        );
    }
    assert!(board().squares_x == 7);
}
